"""The console script ``koord``, in a process of its own, which loads all else with little work.

It is loaded first, so that :mod:`koord.cli.main` and what that imports are loaded so, too.
"""

from __future__ import annotations

from typing import NoReturn

from koord.cli.module_files import look_here_first


def entry() -> NoReturn:
    """Run the command that the arguments name, and exit."""
    look_here_first()
    from koord.cli.lazy_resources import load_argparse

    load_argparse()
    from koord.cli.main import entry

    entry()
