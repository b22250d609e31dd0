"""Handling of Ctrl-C and SIGTERM: rendered samples are saved, and unwanted work stops at once."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager, suppress

TYPE_CHECKING = False  # as in `lajolla`
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType
    from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupt(KeyboardInterrupt):
    """One of the signals."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number  # as a shell has it


def end_at_once(number: int, frame: FrameType | None, message: str = "nothing was written") -> NoReturn:
    """A handler for times when there is nothing to save.

    An exception would not do: it can come in the middle of an import, or of a callback that drops it.
    """
    _tell(f"interrupted; {message}")
    os._exit(128 + number)


def _tell(message: str) -> None:
    """Writes a line to standard error without Python's buffers: a handler may interrupt a `print`."""
    with suppress(OSError):
        os.write(2, f"lajolla: {message}\n".encode())


@contextmanager
def handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Installs a signal handler; ignored signals, as in a shell's background jobs, stay ignored."""
    previous = {number: signal.getsignal(number) for number in SIGNALS}
    heard = [number for number in SIGNALS if previous[number] != signal.SIG_IGN]
    for number in heard:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, previous[number])


def unblock() -> None:
    """Hears signals from now on, those too that came while the launcher had them blocked: Python, when it
    starts, answers Ctrl-C with a traceback."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


class Patience:
    """A handler for work that ends in a save: the first signal stops the work, the next one while saving is
    answered, and one more ends the program.

    It only records: an exception would come anywhere, and what it comes into may drop it.
    """

    def __init__(self, result: str) -> None:
        self.result = result  # what is saved, such as "the picture"
        self.saving = False
        self.warned = False
        self.interrupt: Interrupt | None = None  # the first one

    def __call__(self, number: int, frame: FrameType | None) -> None:
        first = self.interrupt is None
        self.interrupt = self.interrupt or Interrupt(number)
        if self.warned:
            end_at_once(number, frame, f"{self.result} may not be there")
        if self.saving or not first:
            self.warned = True
            _tell(f"{'saving' if self.saving else 'stopping'}; press Ctrl-C again to quit without saving")

    def stopping(self, observe: Callable[[Any], None]) -> Callable[[Any], None]:
        """A progress callback that raises a pending interrupt, and otherwise calls another callback."""

        def observe_or_stop(progress: Any) -> None:  # noqa: ANN401
            if self.interrupt is not None:
                raise self.interrupt
            observe(progress)

        return observe_or_stop

    def save(self, action: Callable[..., Any], *arguments: Any) -> None:  # noqa: ANN401
        """Runs a function in another thread: libraries may take long, and this thread gets the signals."""
        self.saving = True
        import threading
        from concurrent.futures import Future

        done: Future[None] = Future()

        def work() -> None:
            try:
                action(*arguments)
                done.set_result(None)
            except BaseException as problem:
                done.set_exception(problem)

        try:
            threading.Thread(target=work).start()
        except RuntimeError:  # there is no memory for another thread
            work()
        done.result()
