"""``python -m fraexp``."""

import sys

from fraexp.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
