"""The spelling of names."""

import re
from functools import lru_cache

INNER_CAPITALS = re.compile(r"(?<=[a-z0-9])[A-Z]+")


@lru_cache(1024)  # a scene has few names, many times
def snake_case(name: str) -> str:
    """`toWorld` -> `to_world`, `intIOR` -> `int_ior`; what has no inner capital stays."""
    return INNER_CAPITALS.sub(lambda capitals: "_" + capitals.group().lower(), name)
