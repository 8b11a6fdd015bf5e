"""What ``koord sim`` keeps of a run: a page to look at, files for other tools, pictures."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from msgspec import Struct

from koord.api.files import check_folder, write_atomically, write_folder
from koord.api.growing import Growing, Part, remove_part
from koord.cli.arguments import pace
from koord.cli.files import check_writable
from koord.syntax.diagnostics import refusal

if TYPE_CHECKING:
    from koord.cli.simulated_traces import Tracing
    from koord.sim.recording import Recording
    from koord.sim.running import Simulation

#: Where the page goes if nobody says.
_PAGE = "run.html"


class Form(Struct, frozen=True):
    """A form of file, or of folder, to keep a run in: the libraries for it, and their extra."""

    make: Callable[[Recording, str], bytes | Mapping[str, bytes]]
    libraries: tuple[str, ...]
    extra: str
    #: Begins such a file while the run goes on, and gives what writes behind it.
    part: Callable[[Recording, BinaryIO], Callable[[], None]] | None = None
    #: Or one that sees to its file, or folder, itself.
    own: Callable[[Recording, Path], Part] | None = None


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


def _part_page(recording: Recording, file: BinaryIO) -> Callable[[], None]:
    from koord.sim.viewing import PartPage

    return PartPage(recording, file).grow


def _part_mcap(recording: Recording, file: BinaryIO) -> Callable[[], None]:
    from koord.sim.files.mcap import PartRecord

    return PartRecord(recording, file).grow


def _part_rrd(recording: Recording, path: Path) -> Part:
    from koord.sim.files.rerun import PartRrd

    return PartRrd(recording, path)


def _part_bag(recording: Recording, path: Path) -> Part:
    from koord.sim.files.rosbag import PartBag

    return PartBag(recording, path)


#: By the ending of a file's name.
_PLOTS = dict.fromkeys((".png", ".svg", ".pdf"), Form(_plot, ("matplotlib",), "plot"))
_RECORDS = {
    ".mcap": Form(_mcap, ("mcap",), "sim", _part_mcap),
    ".rrd": Form(_rrd, ("rerun",), "export", own=_part_rrd),
    ".rosbag2": Form(_rosbag, ("rosbags",), "export", own=_part_bag),
}
_VIEWS = {
    "2d": Form(_page, (), "sim", _part_page),
    # What grows shows the run from above: a page of space is made as a whole.
    "3d": Form(_space, ("viser",), "view", _part_page),
}

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
        type=pace,
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
    arguments: argparse.Namespace,
    simulation: Simulation,
    tracing: Tracing | None,
    *,
    paced: bool = True,
) -> Iterator[Callable[[float], None]]:
    """While this goes on the run can be watched, and what is kept of it grows.

    What comes out is to be called with the simulated time when a round is over: it keeps the pace
    that is asked for, unless the run is ``paced`` by others. Raises KoordError.
    """
    recording = simulation.recording
    with ExitStack() as stack:
        pace = stack.enter_context(_served(arguments, recording, paced=paced))
        parts = stack.enter_context(Growing())
        for path, form in _wanted(arguments):
            if form.part is not None:
                parts.add(path, partial(form.part, recording))
            if form.own is not None:
                parts.add_own(path, partial(form.own, recording))
        if tracing is not None and arguments.trace is not None:
            parts.add(arguments.trace, partial(_trace, tracing, simulation))

        def step(time_s: float) -> None:
            parts.grow()
            pace(time_s)

        if simulation.recording.rounds:
            parts.grow()
        yield step


def _trace(tracing: Tracing, simulation: Simulation, file: BinaryIO) -> Callable[[], None]:
    from koord.traces.parts import PartTrace

    part = PartTrace(file)

    def grow() -> None:
        if tracing.is_begun:
            part.grow(tracing.so_far(simulation))

    return grow


@contextmanager
def _served(
    arguments: argparse.Namespace, recording: Recording, *, paced: bool
) -> Iterator[Callable[[float], None]]:
    """Keeps the pace, and serves the page if that is asked for. Raises KoordError."""
    factor = arguments.pace or (1.0 if arguments.live else None)
    pace: Callable[[float], None] = _unhurried
    if factor is not None and paced:
        from koord.sim.live import Pace

        pace = Pace(factor).keep
    if not arguments.live:
        yield pace
        return
    from koord.sim.live import Live

    try:
        server = Live(recording)
    except OSError as error:
        story = f"the page cannot be served on this machine: {error.strerror}"
        raise refusal("K933", "--live", story, "leave out --live: run.html shows the run") from None
    with server as live:
        print(f"live: {live.address}", file=sys.stderr, flush=True)
        yield pace
        live.wait_for_watchers(_PATIENCE_S)


def _unhurried(time_s: float) -> None:
    """Without a pace time passes as it does."""


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
        remove_part(path)
        kept.append(path)
    return kept


def _wanted(arguments: argparse.Namespace) -> Iterator[tuple[str, Form]]:
    if arguments.html is not None:
        yield arguments.html, _VIEWS[arguments.view]
    for path in arguments.record:
        yield path, _RECORDS[Path(path).suffix.lower()]
    if arguments.plot is not None:
        yield arguments.plot, _PLOTS[Path(arguments.plot).suffix.lower()]


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
