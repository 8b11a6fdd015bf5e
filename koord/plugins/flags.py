"""Flags of commands, read where there is no command line to end."""

from __future__ import annotations

from typing import NoReturn

from koord.cli.main import Parser


class FlagError(Exception):
    """Raised for flags that are wrong."""


class Flags(Parser):
    """A parser that raises FlagError, and neither prints nor exits."""

    def error(self, message: str) -> NoReturn:
        raise FlagError(message)

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        raise FlagError(message or "--help is for the command line")

    def print_help(self, file: object = None) -> None:
        """Say nothing: :meth:`exit` is called next."""
