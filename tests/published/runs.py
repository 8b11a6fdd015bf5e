"""Programs that are accepted: compiled, refinement-checked and, where they move, simulated."""

from __future__ import annotations

import math
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

import koord
from koord.api.sim_report import Ending
from koord.sim.bounds import moves
from koord.syntax.source import Source, counted
from tests.published.documents import Document
from tests.published.programs import Finding, codes

#: Runs of a program that the rules judge.
RUNS = 20

#: So far the world reaches beyond where robots begin, and at least.
_BEYOND_M, _ROOM_M = 20.0, (-20.0, 20.0)

#: So many tasks there are for programs that have a list of them.
_TASKS = 4

#: Where nobody says where robots begin: so far from each other, and so high what flies.
_APART_M, _HEIGHT_M = 3.0, 1.0


class Simulation(Struct, frozen=True):
    """A program that ran with a configuration, and how that ended."""

    configuration: str  #: the name of its file; empty: the plainest that suits
    scene: str = ""  #: that says where its robots began; empty: the seed did
    robots: int = 0
    ending: str = ""
    time_s: float = 0.0
    broken: tuple[str, ...] = ()  #: claims, such as that robots keep apart: what the program does
    fault: str = ""  #: that ended it: what the program does
    standing: tuple[str, ...] = ()  #: why robots could not go where the program sent them
    refused: tuple[str, ...] = ()  #: codes for which there was no run

    @property
    def is_run(self) -> bool:
        return not self.refused


class Ran(Struct, frozen=True):
    """A program, what its compiled form does, and its simulations."""

    finding: Finding
    runs: int = 0  #: that the rules judged
    steps: int = 0
    faults: int = 0  #: of those runs, how many a fault of the program ended
    simulations: tuple[Simulation, ...] = ()
    trouble: str = ""

    def __str__(self) -> str:
        ran = [one for one in self.simulations if one.is_run]
        said = f"{self.runs} runs, {self.steps} steps"
        if self.faults:
            said += f", {self.faults} ended by its own fault"
        if self.simulations:
            said += f"; simulated {len(ran)} of {counted(len(self.simulations), 'time')}: "
            said += ", ".join(_counted(ran)) or "never"
        return f"{'WRONG' if self.trouble else 'ran':<27}  {self.finding.path.name}  {said}"


def _counted(ran: Sequence[Simulation]) -> list[str]:
    told = dict[str, int]()
    for one in ran:
        words = one.ending
        words += ", too near to each other" if "separation" in one.broken else ""
        if one.standing:
            words += f", stuck ({', '.join(one.standing).replace('_', ' ')})"
        told[words] = told.get(words, 0) + 1
    return [f"{many} × {words}" for words, many in sorted(told.items())]


def ran(finding: Finding, documents: Sequence[Document]) -> Ran:
    """Compile a program, have its runs judged, and simulate it where it moves."""
    try:
        return _ran(finding, documents)
    except Exception:
        return Ran(finding, trouble=traceback.format_exc())


def _ran(finding: Finding, documents: Sequence[Document]) -> Ran:
    assert finding.source is not None
    program = koord.load(finding.source)
    if not koord.compile(program).text:
        return Ran(finding, trouble="it was compiled to nothing")
    judged = koord.refine([program], runs=RUNS)
    totals = judged.targets
    made = Ran(
        finding,
        sum(one.runs for one in totals),
        sum(one.steps for one in totals),
        sum(one.faults for one in totals),
        trouble="" if judged.ok else f"the rules refuse a run: {judged!r}",
    )
    if not moves(program.core):
        return made
    own = [one for one in documents if one.is_configuration and _near(finding.path, one.path)]
    chosen = _different(own or [one for one in documents if one.is_configuration])
    simulations = tuple(_simulated(finding.source, one, documents) for one in chosen)
    if not any(one.is_run for one in simulations):
        simulations += (_simulated(finding.source, None, ()),)
    trouble = made.trouble
    if not simulations[-1].is_run and not any(one.is_run for one in simulations):
        trouble = trouble or "there is no configuration that it runs with"
    return Ran(finding, made.runs, made.steps, made.faults, simulations, trouble)


def _near(one: Path, other: Path) -> bool:
    """Return whether two files are of one folder."""
    return one.parent in (other.parent, *other.parents) or other.parent in one.parents


def _different(documents: Sequence[Document]) -> list[Document]:
    """Of configurations with the same vehicles the first."""
    first: dict[tuple[str, ...], Document] = {}
    for one in documents:
        first.setdefault(one.kinds, one)
    return list(first.values())


def _scene(configuration: Document, documents: Sequence[Document]) -> Document | None:
    """The first scene with the robots of a configuration, by their names."""
    names = sorted(configuration.names)
    fitting = (one for one in documents if not one.is_configuration and sorted(one.names) == names)
    return None if configuration.places else next(fitting, None)


def _site(configuration: Document, scene: Document | None) -> Source:
    """What published configurations do not say: how far the world reaches, and where robots begin.

    They begin where a scene says, or else in rows, what flies in the air.
    """
    places = configuration.places if scene is None else scene.places
    told = ""
    if not places:
        side = math.isqrt(len(configuration.kinds) - 1) + 1
        heights = (_HEIGHT_M if kind == "QUAD" else 0.0 for kind in configuration.kinds)
        places = tuple(
            (_APART_M * (k % side), _APART_M * (k // side), z) for k, z in enumerate(heights)
        )
        numbered = enumerate(places, configuration.first_pid)
        told = ", ".join(f"{pid}: [{x}, {y}, {z}]" for pid, (x, y, z) in numbered)
        told = f"positions: {{{told}}}\n"
    least, most = _ROOM_M
    low = [min(least, *axis) - _BEYOND_M for axis in zip(*places, strict=True)]
    high = [max(most, *axis) + _BEYOND_M for axis in zip(*places, strict=True)]
    bounds = f"{{low: [{low[0]}, {low[1]}, 0], high: [{high[0]}, {high[1]}, {high[2]}]}}"
    return Source("site.yaml", f"{told}world: {{bounds: {bounds}, scattered: {_TASKS}}}\n")


def _simulated(
    program: Source, document: Document | None, documents: Sequence[Document]
) -> Simulation:
    """A run with a configuration, or the plainest that suits the program."""
    scene = None if document is None else _scene(document, documents)
    told: dict[str, Any] = {"configuration": "" if document is None else document.path.name}
    told |= {"scene": "" if scene is None else scene.path.name}
    try:
        configuration = None
        if document is not None:
            placed = None if scene is None else scene.path
            configuration = koord.read_configuration(document.path, _site(document, scene), placed)
        done = koord.simulate(program, configuration, keep_going=True)
    except koord.KoordError as error:
        refused = codes(error.diagnostics)
        return Simulation(**told, refused=refused)
    fault = done.fault
    words = "its own fault" if done.ending is Ending.FAULT else done.ending.value
    return Simulation(
        **told,
        robots=len(done.setup.devices),
        ending=words,
        time_s=done.time_s,
        broken=tuple(dict.fromkeys(one.claim for one in done.broken)),
        fault="" if fault is None else f"{fault.fault.kind.value} of robot {fault.robot}",
        standing=tuple(dict.fromkeys(one.hindrance.name.lower() for one in done.standing)),
    )
