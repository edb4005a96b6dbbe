"""``python -m fraexp``."""

from fraexp.cli.main import console

if __name__ == "__main__":
    console()
