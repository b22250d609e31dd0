"""Handling of Ctrl-C and SIGTERM: renders save their samples so far; other work stops at once."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager, suppress

TYPE_CHECKING = False  # as in `lajolla`
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType
    from typing import Any, NoReturn, TypeVar

    T = TypeVar("T")

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupt(KeyboardInterrupt):
    """SIGINT or SIGTERM was received."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number  # as in shells


def end_at_once(number: int, frame: FrameType | None, message: str = "nothing was written") -> NoReturn:
    """A signal handler that ends the process, for use while there is nothing to save.

    It does not raise an exception, because an import or a callback could be interrupted and drop it.
    """
    _print_error(f"interrupted; {message}")
    os._exit(128 + number)


def _print_error(message: str) -> None:
    """Writes a line to standard error without Python's buffers, because a handler may interrupt a `print`."""
    with suppress(OSError):
        os.write(2, f"lajolla: {message}\n".encode())


@contextmanager
def handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Installs a signal handler; ignored signals, as in a shell's background jobs, stay ignored."""
    previous = {number: signal.getsignal(number) for number in SIGNALS}
    handled = [number for number in SIGNALS if previous[number] != signal.SIG_IGN]
    for number in handled:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, previous[number])


def unblock() -> None:
    """Unblocks the signals, and delivers pending ones. The launcher blocks them because Python, while it
    starts, prints a traceback for Ctrl-C."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


class Patience:
    """A handler for work that ends in a save: the first signal stops the work, the second one prints a hint,
    and the third one ends the program without saving.

    It only records signals: an exception could be raised anywhere, and be dropped by the interrupted code.
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
            step = "saving" if self.saving else "stopping"
            _print_error(f"{step}; press Ctrl-C again to quit without saving")

    def stopping(self, observe: Callable[[Any], None]) -> Callable[[Any], None]:
        """A progress callback that raises a pending interrupt, and otherwise calls another callback."""

        def observe_or_stop(progress: Any) -> None:  # noqa: ANN401
            if self.interrupt is not None:
                raise self.interrupt
            observe(progress)

        return observe_or_stop

    def save(self, action: Callable[..., T], *arguments: Any) -> T:  # noqa: ANN401
        """Runs a function in another thread, so that this one handles signals during long library calls.

        Returns its result.
        """
        self.saving = True
        import threading
        from concurrent.futures import Future

        done: Future[T] = Future()

        def work() -> None:
            try:
                done.set_result(action(*arguments))
            except BaseException as problem:
                done.set_exception(problem)

        try:
            threading.Thread(target=work).start()
        except RuntimeError:  # not enough memory for another thread
            work()
        return done.result()
