"""The spelling of names."""

import re


def snake_case(name: str) -> str:
    """`toWorld` -> `to_world`, `intIOR` -> `int_ior`; what has no inner capital stays."""
    return re.sub(r"(?<=[a-z0-9])[A-Z]+", lambda capitals: "_" + capitals.group().lower(), name)
