"""Selects the build of the core: packages have one for each level of x86-64.

The builds stand side by side in `levels/x86-64-v3/` and so on. The folder of the best one that the processor
runs becomes part of the package's path; `lajolla._core` is found there as in a package with one build.
"""

import os
from collections.abc import Sequence

VARIABLE = "LAJOLLA_ISA"  # the environment's: names a level to use instead

# What each level needs beside the one before, as /proc/cpuinfo calls it (x86-64 psABI, table 3.1).
LEVELS = {
    "x86-64-v2": "cx16 lahf_lm pni popcnt sse4_1 sse4_2 ssse3",
    "x86-64-v3": "abm avx avx2 bmi1 bmi2 f16c fma movbe xsave",
    "x86-64-v4": "avx512bw avx512cd avx512dq avx512f avx512vl",
}


class LevelError(ImportError):
    """No build of the core can be used."""


def builds(package: Sequence[str]) -> dict[str, str]:
    """The folder of each level that a package with these folders has; none where it has a single build."""
    return {
        level: folder
        for level in LEVELS
        for root in package
        if os.path.isdir(folder := os.path.join(root, "levels", level))
    }


def core_folders(package: Sequence[str]) -> list[str]:
    """The folder to import the core from, where a package has several builds of it; otherwise none.

    Raises:
        LevelError: the processor runs no build, or not the one that the environment names.
    """
    there, wanted = builds(package), os.environ.get(VARIABLE, "")
    return [there[choose(list(there), processor_flags(), wanted)]] if there or wanted else []


def choose(levels: Sequence[str], flags: set[str] | None, wanted: str = "") -> str:
    """The best of these levels that a processor with these flags runs, or the one that is wanted.

    Of a processor whose flags are not known, the lowest level is taken, or the wanted one on the user's word.

    Raises:
        LevelError: there is none.
    """
    if wanted:
        if wanted not in levels:
            there = " ".join(levels) or "a single build"
            raise LevelError(f"{VARIABLE}={wanted}: this installation has {there}")
        if flags is not None and (lacking := _lacking(wanted, flags)):
            raise LevelError(f"{VARIABLE}={wanted}: this processor does not have {' '.join(lacking)}")
        return wanted
    if flags is None:
        return levels[0]
    runs = [level for level in levels if not _lacking(level, flags)]
    if not runs:
        lowest = levels[0]
        missing = " ".join(_lacking(lowest, flags))
        raise LevelError(f"lajolla needs a processor of at least {lowest}; this one does not have {missing}")
    return runs[-1]


def level() -> str:
    """The best level that the processor runs, or "unknown"; Embree selects its code in a similar way."""
    flags = processor_flags()
    runs = [level for level in LEVELS if flags is not None and not _lacking(level, flags)]
    return runs[-1] if runs else "unknown"


def processor_flags() -> set[str] | None:
    """The features of the processor that the system lets programs use; None where it does not say."""
    try:
        with open("/proc/cpuinfo") as file:
            line = next((line for line in file if line.startswith("flags")), None)
    except OSError:  # a sandbox hides it
        return None
    return None if line is None else set(line.split())


def _lacking(level: str, flags: set[str]) -> list[str]:
    """The features of a level that a processor with these flags lacks."""
    names = list(LEVELS)
    needed = " ".join(LEVELS[name] for name in names[: names.index(level) + 1])
    return [flag for flag in needed.split() if flag not in flags]
