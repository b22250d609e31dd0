"""`python -m lajolla`, and the program `lajolla`: the command line."""

import os
import sys

try:
    from lajolla import interrupts
except KeyboardInterrupt:  # before there was anything to hear it
    os.write(2, b"lajolla: interrupted; nothing was written\n")
    os._exit(130)


def main() -> int:
    """Runs the command line; loading it can be interrupted as well."""
    with interrupts.handled_by(interrupts.end_at_once):
        interrupts.unblock()
        from lajolla import cli, display

        display.open_streams()
        return cli.main()


if __name__ == "__main__":
    sys.exit(main())
