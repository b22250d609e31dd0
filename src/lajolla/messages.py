"""Messages to users of the package: Python warnings, and errors in options."""

from __future__ import annotations

import difflib
import functools
import shlex
import sys
import warnings
from collections.abc import Callable, Collection
from typing import TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., object])


class Error(Exception):
    """The base of all errors that this package raises for what it was given; messages state the reason."""


class LajollaWarning(UserWarning):
    """A request that is not fulfilled exactly; shown or filtered by Python's `warnings`."""


class ClusterWarning(LajollaWarning):
    """A worker takes no part in a render, or there are none."""


class ClusterError(Error):
    """The workers or their scheduler cannot be used, or not any more; the message states why."""


def warn(warning: LajollaWarning) -> None:
    """Issues a Python warning, located at the caller's line outside of the package."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "lajolla":
        level, frame = level + 1, frame.f_back
    warnings.warn(warning, stacklevel=level)


def suggestion(name: str, known: Collection[str]) -> str:
    """'; did you mean ...?' with the most similar name, or the list of known names."""
    near = difflib.get_close_matches(name, known := list(dict.fromkeys(known)), n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; valid: {', '.join(known)}"


def installing(package: str) -> str:
    """The command that installs a package for this Python."""
    return f"{shlex.quote(sys.executable)} -m pip install {package}"


def shortened(name: object, longest: int = 80) -> str:
    """A name as messages show it where it is too long to be one."""
    text = str(name)
    return text if len(text) <= longest else text[: longest - 3] + "..."


def names_checked(function: Function) -> Function:
    """A decorator: unknown keyword arguments raise a TypeError that suggests the most similar one."""
    code = function.__code__
    known = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]

    @functools.wraps(function)
    def checked(*values: object, **options: object) -> object:
        if unknown := [name for name in options if name not in known]:
            name, options_of = unknown[0], [word for word in known if word != "self"]
            raise TypeError(f"{function.__qualname__}() has no option {name!r}{suggestion(name, options_of)}")
        return function(*values, **options)

    return cast("Function", checked)
