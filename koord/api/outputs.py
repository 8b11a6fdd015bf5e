"""Outputs of a simulated run: a page, files for other tools, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, TypeAlias

from msgspec import Struct

from koord.api.files import check_folder, check_writable, write_atomically, write_folder
from koord.api.growing import Growing, remove_part
from koord.api.progress import Listener
from koord.api.results import ArgumentError
from koord.api.served_page import PATIENCE_S, served_page

if TYPE_CHECKING:
    from koord.api.sim_trace import Tracing
    from koord.sim.run_log import RunLog
    from koord.sim.running import Simulation


class OutputFormat(Struct, frozen=True):
    """A format of files, or folders, for a run: the libraries that it needs, and their extra.

    What makes it is named below ``koord.sim``, and loaded when it is wanted.
    """

    make: str  #: of a log, and what is ``given`` of the path: the file's bytes, or a folder's files
    libraries: tuple[str, ...]
    extra: str
    part: str = ""  #: begins such a file while the run goes on, of a log and the open file
    own: str = ""  #: or sees to its file, or folder, itself, of a log and the path
    given: Callable[[Path], tuple[str, ...]] = lambda path: ()

    def made(self, recording: RunLog, path: str) -> bytes | Mapping[str, bytes]:
        """The file of a run, or the files of its folder."""
        found: bytes | Mapping[str, bytes] = _of_sim(self.make)(recording, *self.given(Path(path)))
        return found


def _of_sim(name: str) -> Any:
    """A function or a class, by its module below ``koord.sim`` and its name."""
    module, _, what = name.rpartition(".")
    return getattr(import_module(f"koord.sim.{module}"), what)


_PLOT = OutputFormat(
    "files.plots.plot_of", ("matplotlib",), "plot", given=lambda path: (path.suffix.lower(),)
)
_PLOTS = dict.fromkeys((".png", ".svg", ".pdf"), _PLOT)
_RECORDS = {
    ".mcap": OutputFormat("files.mcap.mcap_of", ("mcap",), "sim", "files.mcap.PartRecord"),
    ".rrd": OutputFormat("files.rerun.rrd_of", ("rerun",), "export", own="files.rerun.PartRrd"),
    ".rosbag2": OutputFormat(
        "files.rosbag.rosbag_of",
        ("rosbags",),
        "export",
        own="files.rosbag.PartBag",
        given=lambda path: (path.name,),
    ),
}
_VIEWS = {
    "2d": OutputFormat("viewing.page_of", (), "sim", "viewing.PartPage"),
    # What grows shows the run from above: a page of space is made as a whole.
    "3d": OutputFormat("files.space.space_of", ("viser",), "view", "viewing.PartPage"),
}

#: How names of records and of pictures may end.
RECORDS, PLOTS = tuple(_RECORDS), tuple(_PLOTS)

#: What a page shows: the world from above with timeline and variables, or the robots in space.
View: TypeAlias = Literal["2d", "3d"]


class Outputs(Struct, frozen=True):
    """The outputs of a run as files: ``record`` and ``plot`` in the format of their suffixes.

    ``live`` serves the page on this machine while the run goes on; ``pace`` is how many times as
    quickly as on the wall time may pass at most (None: with ``live`` once, else without limit).
    """

    html: str | None = None
    view: View = "2d"
    record: tuple[str, ...] = ()
    plot: str | None = None
    trace: str | None = None
    live: bool = False
    pace: float | None = None

    @property
    def speed(self) -> float | None:
        """The pace to keep; None: no limit."""
        return self.pace or (1.0 if self.live else None)

    def check(self) -> None:
        """Check that all outputs can be made, before long work is done.

        Raises KoordError, and ArgumentError for endings that no form has.
        """
        from koord.runtime.motion.libraries import require

        for path, form in self.files():
            require(form.libraries, form.extra)
            if Path(path).suffix.lower() == ".rosbag2":
                check_folder(path)
            else:
                check_writable(path)

    def files(self) -> Iterator[tuple[str, OutputFormat]]:
        """Yield every file but the trace, with its format. Raises ArgumentError."""
        if self.html is not None:
            yield self.html, _form("view", self.view, self.view, _VIEWS)
        for path in self.record:
            yield path, _form("record", path, Path(path).suffix.lower(), _RECORDS)
        if self.plot is not None:
            yield self.plot, _form("plot", self.plot, Path(self.plot).suffix.lower(), _PLOTS)


def _form(
    argument: str, given: str, ending: str, forms: Mapping[str, OutputFormat]
) -> OutputFormat:
    if ending not in forms:
        raise ArgumentError(argument, f"{given!r} ends in none of {', '.join(forms)}")
    return forms[ending]


@contextmanager
def growing(
    outputs: Outputs,
    simulation: Simulation,
    tracing: Tracing | None,
    tell: Listener,
    *,
    paced: bool = True,
) -> Iterator[Callable[[float], None]]:
    """Within the context, the run can be watched, and its files grow.

    What comes out is to be called with the simulated time when a round is over: it keeps the pace
    that is asked for, unless the run is ``paced`` by others. Raises KoordError.
    """
    recording = simulation.recording
    with ExitStack() as stack:
        pace = stack.enter_context(_served(outputs, recording, tell, paced=paced))
        parts = stack.enter_context(Growing())
        for path, form in outputs.files():
            if form.part:
                parts.add(path, partial(_begun, form.part, recording))
            if form.own:
                parts.add_own(path, partial(_of_sim(form.own), recording))
        if tracing is not None and outputs.trace is not None:
            parts.add(outputs.trace, partial(_trace, tracing, simulation))

        def step(time_s: float) -> None:
            parts.grow()
            pace(time_s)

        if simulation.recording.rounds:
            parts.grow()
        yield step


def _begun(part: str, recording: RunLog, file: BinaryIO) -> Callable[[], None]:
    grow: Callable[[], None] = _of_sim(part)(recording, file).grow
    return grow


def _trace(tracing: Tracing, simulation: Simulation, file: BinaryIO) -> Callable[[], None]:
    from koord.traces.unfinished import GrowingTrace

    part = GrowingTrace(file)

    def grow() -> None:
        if tracing.is_begun:
            part.grow(tracing.so_far(simulation))

    return grow


@contextmanager
def _served(
    outputs: Outputs, recording: RunLog, tell: Listener, *, paced: bool
) -> Iterator[Callable[[float], None]]:
    """Keep the pace, and serve the page if requested. Raises KoordError."""
    pace: Callable[[float], None] = _unhurried
    if outputs.speed is not None and paced:
        from koord.sim.viewing import Throttle

        pace = Throttle(outputs.speed).keep
    if not outputs.live:
        yield pace
        return
    with served_page(recording, tell, "leave out `live=`: run.html shows the run") as live:
        yield pace
        live.wait_for_watchers(PATIENCE_S)


def _unhurried(time_s: float) -> None:
    """Keep no pace."""


def keep(outputs: Outputs, recording: RunLog) -> tuple[str, ...]:
    """Write all outputs, each file whole or not at all; return their names.

    Raises KoordError.
    """
    kept = []
    for path, form in outputs.files():
        made = form.made(recording, path)
        if isinstance(made, bytes):
            write_atomically(path, made)
        else:
            write_folder(path, made)
        remove_part(path)
        kept.append(path)
    return tuple(kept)
