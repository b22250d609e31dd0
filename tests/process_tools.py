"""How tests start programs."""

import subprocess

# As the launcher starts Python: Ctrl-C waits until somebody hears it.
BLOCKED = ["env", "--block-signal=INT"]


def can_block() -> bool:
    """Whether `env` is one that blocks signals."""
    return subprocess.run([*BLOCKED, "true"], capture_output=True, check=False).returncode == 0
