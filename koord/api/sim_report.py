"""Reports of simulated runs: their subject, results and progress."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from msgspec import Struct, to_builtins
from msgspec.structs import asdict

from koord.api.fitting import NO_FILE, Fitted
from koord.api.progress import Progress
from koord.api.results import Result
from koord.api.sim_setup import unanswered
from koord.machine.kept import newly_kept
from koord.runtime.engine import Ended
from koord.runtime.motion.planning import Hindrance as Hindrance
from koord.runtime.motion.world import Point
from koord.sim.bounds import moves
from koord.sim.groups import GroupedSimulation
from koord.sim.measuring import Figures
from koord.sim.run_log import RunLog
from koord.sim.running import BrokenClaim as BrokenClaim
from koord.sim.running import Ending as Ending
from koord.sim.running import Simulation
from koord.sim.running import still_words as still_words
from koord.sim.standing import StandingRobot
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.problem import Problem
from koord.syntax.source import Source
from koord.traces.replay import Refused


class Setup(Struct, frozen=True):
    """A program in its scene, before it runs: places and lengths in metres."""

    problem: Problem
    configuration: str | None  #: the name of its file; None: the plainest one that suits
    devices: tuple[str, ...]  #: what each robot is on
    seed: int
    safety_m: float  #: robots that are nearer to each other are too near; 0: none are
    low: Point  #: from where the world reaches
    high: Point  #: to where
    is_bounded: bool  #: whether the configuration says how far the world reaches
    moves: bool  #: whether the program moves its robots
    by_chance: tuple[str, ...]  #: functions and sensors that no world answers: chance does


def setup_of(fitted: Fitted) -> Setup:
    """The subject of a run."""
    configuration, scene, core = fitted.configuration, fitted.scene, fitted.program.core
    is_file = configuration.name != NO_FILE
    return Setup(
        problem=fitted.problem,
        configuration=configuration.name if is_file else None,
        devices=tuple(scene.names),
        seed=scene.seed,
        safety_m=scene.safety_m,
        low=scene.world.low,
        high=scene.world.high,
        is_bounded=configuration.bounded and is_file,
        moves=moves(core),
        by_chance=unanswered(fitted),
    )


class ProgramReloaded(Progress, frozen=True, kw_only=True):
    """Progress: the program was edited. ``diagnostics`` say what was wrong with it, if anything.

    ``accepted``: it goes on, and ``notes`` say which values are not kept.
    """

    accepted: bool
    notes: tuple[str, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    sources: tuple[Source, ...] = ()


class Processes(Struct, frozen=True):
    """The results of programs that ran in several processes."""

    groups: tuple[tuple[int, ...], ...]  #: the robots of each process; none if there was one
    late: int  #: proposals that came too late for their rounds
    died: tuple[int, ...]  #: robots whose processes were ended


class Simulated(Result, frozen=True, kw_only=True):
    """The result of a simulated run. Times are simulated seconds, except ``wall_s``."""

    setup: Setup
    ending: Ending
    time_s: float  #: when the last round began
    wall_s: float  #: how long the run took
    figures: Figures
    claims: Mapping[str, int]  #: how often each claim was looked at
    broken: tuple[BrokenClaim, ...]  #: claims that do not hold
    standing: tuple[StandingRobot, ...]  #: robots that stand still at the end and should go
    fault: Ended | None  #: the fault that ended the run
    refused: Refused | None = None  #: why the trace is none of the semantics
    processes: Processes | None = None  #: of a run with programs in several processes
    warnings: tuple[Diagnostic, ...] = ()
    kept: tuple[str, ...] = ()  #: the files that were written, but for the trace
    kept_code: str = ""  #: where machine code is kept that was made; empty: none was
    recording: RunLog

    @property
    def ok(self) -> bool:
        """True if the run was completed, and nothing was broken, refused, faulty or stuck."""
        wrong = self.broken or self.fault or self.standing or self.refused
        trouble = self.processes is not None and self.processes.died
        return not wrong and not trouble and self.ending is not Ending.INTERRUPTED

    def to_dict(self) -> dict[str, object]:
        """As ``koord sim --json`` prints it."""
        setup, fault = self.setup, None
        if self.fault is not None:
            said = {"kind": self.fault.fault.kind.value, "robot": self.fault.robot}
            fault = asdict(self.fault.fault) | said
        return {
            "format": "koord-simulated",
            "version": 1,
            "program": setup.problem.texts[0],
            "problem": setup.problem.document(),
            "seed": setup.seed,
            "ending": self.ending.name.lower(),
            **to_builtins(self.figures),
            "devices": list(setup.devices),
            "safety_m": setup.safety_m,
            "bounds": {"low": setup.low, "high": setup.high, "given": setup.is_bounded},
            "wall_s": self.wall_s,
            "claims": dict(self.claims),
            "by_chance": list(setup.by_chance),
            "broken": [to_builtins(broken) for broken in self.broken],
            "standing": [_standing(one) for one in self.standing],
            "fault": fault,
            **({} if self.processes is None else {"late": self.processes.late}),
        }

    def page(self) -> bytes:
        """The run as a self-contained HTML file: a map and a timeline."""
        from koord.sim.viewing import page_of

        return page_of(self.recording)

    def mcap(self) -> bytes:
        """The run as an MCAP file."""
        from koord.sim.files.mcap import mcap_of

        return mcap_of(self.recording)

    def __repr__(self) -> str:
        figures, problem = self.figures, self.setup.problem
        said = f"<Simulated {problem.name}, {len(figures.robots)} robots, seed {self.setup.seed}: "
        said += f"{self.ending.value} after {figures.time_s:.1f} s, {figures.distance_m:.1f} m"
        if figures.tasks:
            said += f", {figures.tasks_done} of {len(figures.tasks)} tasks visited"
        if self.broken:
            said += f", broken: {', '.join(dict.fromkeys(one.claim for one in self.broken))}"
        if self.standing:
            said += f", {still_words(len(self.standing))}"
        return said + ">"

    def _repr_html_(self) -> str:
        page = escape(self.page().decode("utf-8"))
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 36em; border: 0"></iframe>'


def _standing(one: StandingRobot) -> dict[str, Any]:
    why = one.hindrance.name.lower()
    return {"robot": one.robot, "since_s": one.since_s, "why": why, "words": one.words}


def report_of(fitted: Fitted, setup: Setup, simulation: Simulation, wall_s: float) -> Simulated:
    """Make the result of a finished run."""
    assert simulation.ending is not None
    return Simulated(
        setup=setup,
        ending=simulation.ending,
        time_s=simulation.time_s,
        wall_s=wall_s,
        figures=simulation.figures(),
        claims=simulation.looked,
        broken=tuple(simulation.broken),
        standing=simulation.standing,
        fault=simulation.fault,
        processes=_processes_of(simulation),
        warnings=fitted.warnings,
        kept_code=newly_kept(),
        recording=simulation.recording,
    )


def _processes_of(simulation: Simulation) -> Processes | None:
    if not isinstance(simulation, GroupedSimulation):
        return None
    return Processes(simulation.groups, simulation.late, simulation.died)


# --- what is told while it goes on ----------------------------------------------------------------


class SimulationBegun(Progress, frozen=True, kw_only=True):
    """Progress: the run begins."""

    setup: Setup
    processes: int = 0  #: so many have programs, this one included; 0: this one alone


class StandsStill(Progress, frozen=True, kw_only=True):
    """Progress: a robot stands still although it has a goal."""

    standing: StandingRobot


class SimulationOver(Progress, frozen=True, kw_only=True):
    """Progress: the run is over; its files are written next."""

    simulated: Simulated


def round_over(simulation: Simulation) -> Progress:
    """Make the progress of a run after a round."""
    figures, time_s = simulation.gauge, simulation.time_s
    said = f"{time_s:.1f} s simulated"
    if figures.tasks:
        said += f", {figures.visited} of {figures.tasks} tasks"
    return Progress(said, simulation.engine.round, time_s)


def standing_words(one: StandingRobot) -> str:
    """Describe a robot that stands still, since when, and why."""
    return f"robot {one.robot} stands still since {one.since_s:.1f} s: {one.words}"
