"""``koord doctor``: what is installed, what is missing, and what that would give."""

from __future__ import annotations

import argparse
from argparse import ArgumentTypeError
from collections.abc import Iterator, Sequence

from koord.api.doctor import Doctor, FoundPackage, doctor
from koord.api.drivers import DriverEntry
from koord.api.results import ArgumentError
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.terminal import visible
from koord.version import __version__


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "wanted",
        metavar="NAME",
        nargs="*",
        help="an extra or a tool that has to be there, as fast or abc: else the exit code is 1",
    )
    add_json(parser, "what was found")
    parser.epilog = (
        "exit codes: 0 all is there that koord needs, and each NAME; 1 something is missing, or\n"
        "cannot be loaded; 2 there is no such NAME"
    )


def main(arguments: argparse.Namespace) -> int:
    try:
        found = doctor(*arguments.wanted)
    except ArgumentError as error:
        raise ArgumentTypeError(error.message) from None
    if arguments.json:
        print(found.to_json())
    else:
        print("\n".join(map(visible, lines(found))))
    return Exit.OK if found.ok else Exit.VIOLATED


def lines(found: Doctor) -> Iterator[str]:
    """The lines that tell of an installation."""
    yield f"koord {__version__}, Python {found.python} at {found.executable}"
    cores = "1 core" if found.cores == 1 else f"{found.cores} cores"
    yield f"{found.system}, {cores}"
    cache = found.cache
    entries = "1 verdict" if cache.entries == 1 else f"{cache.entries:,} verdicts"
    yield f"cache: {cache.folder}, {entries}, {cache.size_bytes / 2**20:.1f} MiB"
    yield from _table("needed", [(one.name, _version(one), "") for one in found.needed])
    yield from _table(
        "extras",
        [
            (
                one.name,
                f"missing: {', '.join(one.missing)}" if one.missing else "installed",
                f"{one.gives} ({one.cure})" if one.missing else one.gives,
            )
            for one in found.extras
        ],
    )
    yield from _table(
        "tools of others",
        [
            (
                one.name,
                one.path or "missing",
                one.gives if one.path else f"{one.gives} ({one.cure})",
            )
            for one in found.tools
        ],
    )
    yield from _table("drivers", _entries(found.drivers))
    yield from _table("localisers", _entries(found.localisers))
    yield ""
    if found.ok:
        yield "all is there that koord needs" + _and(found.wanted)
    yield from (f"problem: {problem}" for problem in found.problems)


def _and(wanted: Sequence[str]) -> str:
    return f", and {', '.join(wanted)}" if wanted else ""


def _version(one: FoundPackage) -> str:
    if one.trouble is not None:
        return one.trouble
    return one.version or "missing"


def _entries(found: Sequence[DriverEntry]) -> list[tuple[str, str, str]]:
    return [
        (one.name, "missing packages" if one.missing else "installed", one.package) for one in found
    ]


def _table(heading: str, rows: Sequence[tuple[str, str, str]]) -> Iterator[str]:
    yield ""
    yield f"{heading}:"
    names, states = (max(len(row[k]) for row in rows) for k in (0, 1))
    states = min(states, _WIDEST)
    for name, state, more in rows:
        yield f"  {name:<{names}}  {state:<{states}}  {more}".rstrip()


#: Where the longest state is as long as a path, the others leave no gap as wide.
_WIDEST = 24
