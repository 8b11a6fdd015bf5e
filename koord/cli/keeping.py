"""What ``koord sim`` keeps of a run: a page to look at, files for other tools, pictures."""

from __future__ import annotations

import argparse
import os
import sys
import time
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from koord.cli.arguments import number
from koord.cli.files import check_folder, check_writable, write_atomically, write_folder
from koord.syntax.diagnostics import refusal

if TYPE_CHECKING:
    from koord.sim.files.mcap import PartRecord
    from koord.sim.recording import Recording
    from koord.sim.viewing import PartPage

#: Where the page goes if nobody says.
_PAGE = "run.html"


@dataclass(frozen=True, slots=True)
class Form:
    """A form of file, or of folder, to keep a run in: the libraries for it, and their extra."""

    make: Callable[[Recording, str], bytes | Mapping[str, bytes]]
    libraries: tuple[str, ...]
    extra: str


def _mcap(recording: Recording, path: str) -> bytes:
    from koord.sim.files.mcap import mcap_of

    return mcap_of(recording)


def _page(recording: Recording, path: str) -> bytes:
    from koord.sim.viewing import page_of

    return page_of(recording)


def _plot(recording: Recording, path: str) -> bytes:
    from koord.sim.files.plots import plot_of

    return plot_of(recording, Path(path).suffix.lower())


def _rrd(recording: Recording, path: str) -> bytes:
    from koord.sim.files.rerun import rrd_of

    return rrd_of(recording)


def _rosbag(recording: Recording, path: str) -> Mapping[str, bytes]:
    from koord.sim.files.rosbag import rosbag_of

    return rosbag_of(recording, Path(path).name)


def _space(recording: Recording, path: str) -> bytes:
    from koord.sim.files.space import space_of

    return space_of(recording)


#: By the ending of a file's name.
_PLOTS = dict.fromkeys((".png", ".svg", ".pdf"), Form(_plot, ("matplotlib",), "plot"))
_RECORDS = {
    ".mcap": Form(_mcap, ("mcap",), "sim"),
    ".rrd": Form(_rrd, ("rerun",), "export"),
    ".rosbag2": Form(_rosbag, ("rosbags",), "export"),
}
_VIEWS = {"2d": Form(_page, (), "sim"), "3d": Form(_space, ("viser",), "view")}

#: What is new is kept so often.
_PERIOD_S = 1.0

#: How long a live page may take to fetch the end of a run.
_PATIENCE_S = 3.0


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
        "--view",
        choices=tuple(_VIEWS),
        default="2d",
        help="what the page shows: the world from above with timeline and variables, or the "
        "robots in space (2d)",
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="serve the page on this machine while the run goes on, which then takes as long as "
        "it would",
    )
    parser.add_argument(
        "--pace",
        metavar="FACTOR",
        type=_pace,
        help="let time pass at most so many times as quickly as on the wall (with --live 1, else "
        "without limit)",
    )
    parser.add_argument(
        "--record",
        metavar="FILE",
        type=_record,
        action="append",
        default=[],
        help="record the run for other tools, in the form that FILE ends in: "
        f"{_known(_RECORDS)} (a rosbag2 folder); may be given several times",
    )
    parser.add_argument(
        "--plot",
        metavar="FILE",
        type=_picture,
        help="draw positions against time, and how a map grew, to a file that ends in "
        f"{_known(_PLOTS)}",
    )


def check_outputs(arguments: argparse.Namespace) -> None:
    """Whether all that is asked for can be made, before long work is done. Raises KoordError."""
    from koord.runtime.motion.libraries import require

    for path, form in _wanted(arguments):
        require(form.libraries, form.extra)
        if Path(path).suffix.lower() == ".rosbag2":
            check_folder(path)
        else:
            check_writable(path)


@contextmanager
def watched(
    arguments: argparse.Namespace, recording: Recording
) -> Iterator[Callable[[float], None]]:
    """While this goes on the run can be watched, if that is asked for.

    What comes out keeps the pace: it is to be called with the simulated time. Raises KoordError.
    """
    factor = arguments.pace or (1.0 if arguments.live else None)
    with _Parts(arguments, recording) as parts:
        if factor is None:
            yield parts.grow
            return
        with _paced(arguments, recording, factor) as pace:

            def step(time_s: float) -> None:
                parts.grow(time_s)
                pace(time_s)

            yield step


@contextmanager
def _paced(
    arguments: argparse.Namespace, recording: Recording, factor: float
) -> Iterator[Callable[[float], None]]:
    """Keeps the pace, and serves the page if that is asked for. Raises KoordError."""
    from koord.sim.live import Live, Pace

    pace = Pace(factor).keep
    if not arguments.live:
        yield pace
        return
    try:
        server = Live(recording)
    except OSError as error:
        story = f"the page cannot be served on this machine: {error.strerror}"
        raise refusal("K933", "--live", story, "leave out --live: run.html shows the run") from None
    with server as live:
        print(f"live: {live.address}", file=sys.stderr, flush=True)
        yield pace
        live.wait_for_watchers(_PATIENCE_S)


class _Parts:
    """What is kept of a run while it goes on, in files beside those that are asked for.

    They are there if the process is killed, up to the last second of the wall; when the run is kept
    as a whole they are removed.
    """

    def __init__(self, arguments: argparse.Namespace, recording: Recording) -> None:
        self._arguments, self._recording = arguments, recording
        self._growing: list[PartPage | PartRecord] = []
        self._next_s = time.monotonic() + _PERIOD_S
        self._stack = ExitStack()

    def __enter__(self) -> _Parts:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def grow(self, time_s: float) -> None:
        """Write what is new, if it is time. Raises KoordError."""
        now_s = time.monotonic()
        if now_s < self._next_s:
            return
        try:
            if not self._growing:
                self._begin()
            for one in self._growing:
                one.grow()
        except OSError as error:
            raise refusal("K903", "the run", f"cannot be written: {error.strerror}") from None
        self._next_s = time.monotonic() + _PERIOD_S

    def _begin(self) -> None:
        """A run that is over within a second needs no such files."""
        from koord.sim.viewing import PartPage

        for path, _ in _wanted(self._arguments):
            is_page, is_record = path == self._arguments.html, Path(path).suffix.lower() == ".mcap"
            if not (is_page or is_record) or (os.path.exists(path) and not os.path.isfile(path)):
                continue
            file = self._stack.enter_context(Path(part_of(path)).open("wb"))  # noqa: SIM115
            if is_page:
                self._growing.append(PartPage(self._recording, file))
            else:
                from koord.sim.files.mcap import PartRecord

                self._growing.append(PartRecord(self._recording, file))


def part_of(path: str) -> str:
    """Where a file grows while the run goes on."""
    return str(Path(path).with_suffix(f".part{Path(path).suffix}"))


def keep(arguments: argparse.Namespace, recording: Recording) -> list[str]:
    """Write all that is asked for, each file whole or not at all; the files' names.

    Raises KoordError.
    """
    kept = []
    for path, form in _wanted(arguments):
        made = form.make(recording, path)
        if isinstance(made, bytes):
            write_atomically(path, made)
        else:
            write_folder(path, made)
        with suppress(OSError):
            os.unlink(part_of(path))
        kept.append(path)
    return kept


def _wanted(arguments: argparse.Namespace) -> Iterator[tuple[str, Form]]:
    if arguments.html is not None:
        yield arguments.html, _VIEWS[arguments.view]
    for path in arguments.record:
        yield path, _RECORDS[Path(path).suffix.lower()]
    if arguments.plot is not None:
        yield arguments.plot, _PLOTS[Path(arguments.plot).suffix.lower()]


def _pace(text: str) -> float:
    factor = float(number(text))
    if factor <= 0:
        raise ArgumentTypeError(f"{text!r} is not more than 0")
    return factor


def _record(text: str) -> str:
    return _of_a_form(text, _RECORDS)


def _picture(text: str) -> str:
    return _of_a_form(text, _PLOTS)


def _of_a_form(text: str, forms: dict[str, Form]) -> str:
    if Path(text).suffix.lower() not in forms:
        raise ArgumentTypeError(f"{text!r} ends in none of {_known(forms)}")
    return text


def _known(forms: dict[str, Form]) -> str:
    return ", ".join(forms)
