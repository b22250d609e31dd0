"""How commands end: errors become one message, and interrupts say what is missing."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial

import lajolla  # its modules are loaded when they are first used, which no --help does
from lajolla.arguments import UsageError
from lajolla.display import discard, print_message, say
from lajolla.interrupts import Interrupt, end_at_once, handled_by

Command = Callable[[argparse.Namespace], int]


def reported(action: Callable[[], int], missing: str = "nothing was written") -> int:
    """Runs a command; errors become one message and exit code 1, interrupts report what is incomplete."""
    with handled_by(partial(end_at_once, message=missing)):
        try:
            return action()
        except UsageError as error:
            say(f"error: {error}")
        except MemoryError:
            say("error: not enough memory")
        except BrokenPipeError:  # the reader of our output has seen enough, as in `lajolla list | head`
            discard(sys.stdout)
        except lajolla.processor.LevelError as error:
            say(f"error: {error}")
        except OSError as error:
            file = f"{error.filename}: " if error.filename else ""
            say(f"error: {file}{error.strerror or error}")
            discard(sys.stdout)
        except KeyboardInterrupt as interrupt:
            say(f"interrupted; {missing}")
            return interrupt.exit_code if isinstance(interrupt, Interrupt) else 130
        except Exception as error:  # a fault of ours, or of a library: one line, as all else
            say(f"error: {type(error).__name__}: {next(iter(str(error).splitlines()), '')}")
        return 1


def explained(command: Command, arguments: argparse.Namespace) -> int:
    """Runs a command; an error of a scene, option or picture becomes one message."""
    # This loads the renderer, outside of the block whose handlers need it: the user may interrupt already.
    refusals = (
        *(lajolla.OptionError, lajolla.ImageError, lajolla.ClusterError),
        lajolla._core.DescriptionError,
    )
    try:
        return command(arguments)
    except lajolla.SceneError as error:
        print_message(error)
    except refusals as error:
        say(f"error: {error}")
    return 1
