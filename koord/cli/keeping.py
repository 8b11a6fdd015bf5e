"""What ``koord sim`` keeps of a run: a page to look at, files for other tools, pictures."""

from __future__ import annotations

import argparse
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from koord.cli.files import check_writable, write_atomically

if TYPE_CHECKING:
    from koord.sim.recording import Recording

#: Where the page goes if nobody says.
_PAGE = "run.html"


@dataclass(frozen=True, slots=True)
class Form:
    """A form of file that a run can be kept in: the libraries it needs, and the extra with them."""

    make: Callable[[Recording, str], bytes]
    libraries: tuple[str, ...]
    extra: str


def _mcap(recording: Recording, path: str) -> bytes:
    from koord.sim.files.mcap import mcap_of

    return mcap_of(recording)


def _page(recording: Recording, path: str) -> bytes:
    from koord.sim.viewing import page_of

    return page_of(recording)


#: By the ending of a file's name.
_RECORDS = {".mcap": Form(_mcap, ("mcap",), "sim")}
_VIEWS = {"2d": Form(_page, (), "sim")}


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """The flags that say what is kept."""
    parser.add_argument(
        "--html",
        metavar="FILE",
        default=_PAGE,
        help=f"where the page goes that shows the run; it loads nothing from elsewhere ({_PAGE})",
    )
    parser.add_argument(
        "--no-html", dest="html", action="store_const", const=None, help="make no page"
    )
    parser.add_argument(
        "--record",
        metavar="FILE",
        type=_record,
        action="append",
        default=[],
        help=f"record the run for other tools, in the form that FILE ends in: {_known(_RECORDS)}; "
        "may be given several times",
    )


def check_outputs(arguments: argparse.Namespace) -> None:
    """Whether all that is asked for can be made, before long work is done. Raises KoordError."""
    from koord.runtime.motion.libraries import require

    for path, form in _wanted(arguments):
        require(form.libraries, form.extra)
        check_writable(path)


def keep(arguments: argparse.Namespace, recording: Recording) -> list[str]:
    """Write all that is asked for, each file whole or not at all; the files' names.

    Raises KoordError.
    """
    kept = []
    for path, form in _wanted(arguments):
        write_atomically(path, form.make(recording, path))
        kept.append(path)
    return kept


def _wanted(arguments: argparse.Namespace) -> Iterator[tuple[str, Form]]:
    if arguments.html is not None:
        yield arguments.html, _VIEWS["2d"]
    for path in arguments.record:
        yield path, _RECORDS[Path(path).suffix.lower()]


def _record(text: str) -> str:
    if Path(text).suffix.lower() not in _RECORDS:
        raise ArgumentTypeError(f"{text!r} ends in none of {_known(_RECORDS)}")
    return text


def _known(forms: dict[str, Form]) -> str:
    return ", ".join(forms)
