"""Pieces of messages."""

from __future__ import annotations

from collections.abc import Iterable

from koord.syntax.types import Type, show


def a(type_: Type) -> str:
    """The type in backquotes, with its article."""
    shown = show(type_)
    return f"{'an' if shown[0].lower() in 'aeio' else 'a'} `{shown}`"


def choice(what: str, names: Iterable[str]) -> str:
    """What there is to choose from: ``its ports are `x` and `y` ``, or that it has none."""
    shown = listed(names)
    plural, _, _ = what.removeprefix("its ").partition(" ")
    return f"{what} {shown}" if shown else f"it has no {plural}"


def listed(names: Iterable[str]) -> str:
    """The names in backquotes, with commas and a final `and`."""
    shown = [f"`{name}`" for name in names]
    if len(shown) < 2:
        return "".join(shown)
    return f"{', '.join(shown[:-1])} and {shown[-1]}"
