"""What identifies a scene: hashes of the contents of its description, wherever its files are."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

LONGEST_VALUE = 4096  # characters of a section that is kept as it is, instead of its hash


def sections(core: Mapping[str, Any]) -> dict[str, Any]:
    """The sections of a description: small ones as they are, in plain numbers and texts, others as hashes.

    Equal sections have equal values, and differing sections differ.
    """
    hashes = ContentHash()
    return {name: _plain(value) or hashes.digest(value) for name, value in core.items()}


def differences(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[str]:
    """What differs between the sections of two scenes, for a message: "integrator.max_depth is 5 and 8"."""
    found = []
    for name in sorted({*a, *b}):
        x, y = a.get(name), b.get(name)
        if isinstance(x, Mapping) and isinstance(y, Mapping):
            found += [
                f"{name}.{field} is {x.get(field, 'not given')} and {y.get(field, 'not given')}"
                for field in sorted({*x, *y})
                if x.get(field) != y.get(field)
            ]
        elif x != y:
            found.append(f"{name} differ" if name.endswith("s") else f"{name} differs")
    return found


def _plain(value: Any) -> Any:  # noqa: ANN401
    """A small value of numbers, texts, lists and dicts as such; None for others."""
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.size < LONGEST_VALUE else None
    if isinstance(value, Mapping):
        items = {str(key): _plain(item) for key, item in value.items()}
        plain: Any = None if None in items.values() else items
    elif isinstance(value, list | tuple):
        plain = [_plain(item) for item in value] if len(value) < LONGEST_VALUE else None
        plain = None if plain is not None and None in plain else plain
    else:
        plain = value if isinstance(value, bool | int | float | str) else None
    return plain if plain is not None and len(repr(plain)) <= LONGEST_VALUE else None


class ContentHash:
    """Hashes of values; objects of the core that occur several times are hashed once."""

    def __init__(self) -> None:
        self.known: dict[int, bytes] = {}  # hashes of objects of the core by their id()

    def digest(self, value: Any) -> str:  # noqa: ANN401
        return self._hashed(value).hex()

    def _hashed(self, value: Any) -> bytes:  # noqa: ANN401
        """Values of different types, such as 1 and 1.0, have different hashes; arrays and lists too."""
        result = hashlib.blake2b(digest_size=16)
        if isinstance(value, Mapping):
            result.update(b"dict")
            for key in sorted(value):
                result.update(self._hashed(key) + self._hashed(value[key]))
        elif isinstance(value, list | tuple):
            result.update(b"list" + b"".join(map(self._hashed, value)))
        elif isinstance(value, np.ndarray):
            result.update(f"array {value.dtype.str} {value.shape}".encode())
            result.update(np.ascontiguousarray(value).data)
        elif value is None or isinstance(value, bool | int | float | str | bytes | np.generic):
            result.update(f"{type(value).__name__} {value!r}".encode())
        else:
            return self._hashed_object(value)
        return result.digest()

    def _hashed_object(self, value: Any) -> bytes:  # noqa: ANN401
        """Of an object of the core, by what it is pickled as."""
        if id(value) not in self.known:
            self.known[id(value)] = self._hashed([type(value).__name__, value.__getstate__()])
        return self.known[id(value)]
