"""``python -m koord`` is the command ``koord``."""

from koord.cli.start import entry

if __name__ == "__main__":
    entry()
