"""``python -m koord`` is the command ``koord``."""

from koord.cli.main import entry

if __name__ == "__main__":
    entry()
