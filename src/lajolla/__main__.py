"""`python -m lajolla`: the command line."""

import sys

from lajolla.cli import main

sys.exit(main())
