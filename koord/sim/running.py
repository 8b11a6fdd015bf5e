"""Simulated runs: rounds of a compiled program, in a world where time passes between them.

Nothing here reads a clock or waits: the time of a run is virtual. Equal seeds, programs and scenes
give equal runs, and equal :attr:`Figures.digest`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from operator import itemgetter
from typing import Any, Protocol

import numpy as np
from msgspec import Struct

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.engine import Deployed, Ended, Resumed, Schedule
from koord.runtime.engine import RoundEngine as Engine
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.planners import planner
from koord.runtime.motion.world import Point
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.robot import Host, Robot, Status
from koord.sim.digest import Digest
from koord.sim.fleet import Fleet
from koord.sim.hosting import Hosted
from koord.sim.lidar import Scanner
from koord.sim.measuring import Figures, Gauge
from koord.sim.observing import Observer, deeds_in, header_of, nothing
from koord.sim.radio import OverRadio
from koord.sim.reading import Reader
from koord.sim.reloading import declared_in, extended
from koord.sim.run_log import Deeds, Header, Idle, LoggedReload, RunLog, RunLogger
from koord.sim.scene import Scene
from koord.sim.scene_library import library_of
from koord.sim.separation import Nearest
from koord.sim.standing import StandingRobot, Watchman
from koord.syntax.collector import uncollected

#: A run in which nothing has changed for so long is over.
_STILL_S = 3.0


#: A robot that waits gets the same path to the same goal for so many rounds; then it gets another,
#: which may be clear where that one was not. Planning in every round is most of what waiting costs.
_KEPT_ROUNDS = 5


#: The claim about how far robots are apart, which is the scene's.
_APART = "separation"


class Ending(Enum):
    """The reasons for the end of a run."""

    STOPPED = "all robots have stopped"
    STILL = "nothing changes any more"
    LIMIT = "the time was up"
    VIOLATED = "a claim was broken"
    FAULT = "a fault"
    INTERRUPTED = "interrupted"
    SILENT = "a robot told nothing more"
    PLAYED = "the recorded run is over"


class SilentError(Exception):
    """Raised where a process has ended that robots' programs were in."""


class BrokenClaim(Struct, frozen=True):
    """A claim that does not hold: its name, kind (``sort``), time, robots and place."""

    claim: str
    time_s: float
    robots: tuple[int, ...] = ()
    place: Point | None = None
    words: str = ""
    sort: str = ""


class WatchPoint(Enum):
    """The points of a round at which claims are checked."""

    BEGUN = "after INIT"
    EVENTS = "after the robots' events"
    ROUND = "at the end of a round"
    RELOADED = "after another program goes on"


class Claims(Protocol):
    """A monitor of claims."""

    @property
    def looked(self) -> dict[str, int]:
        """The number of checks of each claim."""
        ...

    @property
    def glances(self) -> bool:
        """True if :meth:`glance` is to be called at every tick."""
        ...

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the claims that do not hold now."""
        ...

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the claims that the world violates, at a tick between two rounds."""
        ...


class Striding(Protocol):
    """What makes many rounds at once, in all of which but the first nobody acts."""

    def make(self, until_s: float) -> list[Decision]:
        """Make rounds that begin before a time; none where one is to be made by itself."""
        ...


class Cast(Struct, frozen=True):
    """A compiled program, with the kind of each robot.

    ``differing`` is each value that is not the text's, in words. ``turns`` is the machine code of
    the program, by which long runs go on; None: they do not.
    """

    name: str
    text: str
    classes: tuple[type[Robot], ...]
    kinds: tuple[int, ...]
    differing: tuple[str, ...] = ()
    turns: LazyTurns | None = None


def header_in(cast: Cast, scene: Scene) -> Header:
    """The header of a run of a cast in a scene."""
    return header_of(
        cast.name,
        cast.text,
        cast.classes,
        cast.kinds,
        scene.world,
        scene.robots,
        delta_s=scene.delta_s,
        seed=scene.seed,
        safety_m=scene.safety_m,
        devices=scene.names,
        differing=cast.differing,
    )


class NextProgram(Struct, frozen=True, eq=False):
    """Another program for a run in progress, and what wraps hosts for it. [RELOAD]

    ``claims`` makes the monitors of its claims, and ``words`` say what is not kept.
    """

    cast: Cast
    heard: Callable[[Host], Host] | None
    supplied: Callable[[Host], Host] | None
    claims: Callable[[Simulation], list[Claims]]
    words: tuple[str, ...] = ()


class Simulation:
    """A run, round by round: :meth:`begin` first, then :meth:`round` until ``ending`` is set."""

    def __init__(
        self,
        cast: Cast,
        scene: Scene,
        schedule: Schedule | None = None,
        *,
        keep_going: bool = False,
        heard: Callable[[Host], Host] | None = None,
        supplied: Callable[[Host], Host] | None = None,
        engine: Callable[[Cast, float, Host], Engine] | None = None,
    ) -> None:
        """Make a run; ``heard`` may wrap the program's host.

        ``supplied`` makes of the world's host one that answers what no world does. ``engine``
        makes what runs programs; by default it is :func:`engine_of`.
        """
        self.cast, self.scene, self.keep_going = cast, scene, keep_going
        self.waits = False  #: for edits of the program, so that it goes on where nothing changes
        self.claims: list[Claims] = []  #: that are watched; to be filled before the run begins
        self.fleet = Fleet(scene.world, scene.robots, scene.seed)
        self.host = host_of(cast, scene, self.fleet)
        self.schedule: Schedule = schedule if schedule is not None else Deployed()
        if scene.radio.carries_rounds:
            self.schedule = OverRadio(self.schedule, self.host.reception)
        bodies = [placed.model.body for placed in scene.robots]
        self.watchman = _watchman(self.fleet)(scene.world, bodies)
        self.decision = Decision(INIT_ROUND, (), (), ())  #: the last one
        self.claims_host: Host = self.host  #: whom claims ask
        #: Reads all sensors at once, if nobody is to be asked for those of each robot.
        self.reader: Reader | None = None
        self._make_engine = engine_of if engine is None else engine
        self.engine = self._engine(cast, heard, supplied)
        self.recorder = RunLogger(header_in(cast, scene))
        self.observer = Observer(self.recorder, self.engine, self.fleet)
        self.gauge = Gauge(self.fleet, self.engine, self.recorder, scene)
        self.ending: Ending | None = None
        self.broken: list[BrokenClaim] = []
        self.noticed: list[
            StandingRobot
        ] = []  #: robots that were seen to stand still, as it was seen
        self.standing: tuple[
            StandingRobot, ...
        ] = ()  #: those that stand still when the run has ended
        self._told: set[tuple[str, tuple[int, ...]]] = set()
        #: Robots that have run an event since the environment's turn; others are as they were then.
        self.acted = set(range(len(cast.kinds)))
        self._digest = Digest(len(cast.kinds))
        self._nobody: Bools = np.zeros(len(cast.kinds), np.bool_)  #: that has stopped
        self._deeds: Deeds = nothing(len(cast.kinds))  #: in the last round
        self._before: tuple[Any, ...] | None = None
        self._own = [_own_variables(program) for program in cast.classes]
        self._still = 0

        self._earlier: dict[str, int] = {}  #: how often claims of earlier programs were checked

        #: Makes what makes rounds in which nobody acts, many at once; None: there is to be none.
        self.striding: Callable[[Simulation], Striding | None] | None = None
        self._strides: Striding | None = None

    @property
    def is_over(self) -> bool:
        return self.ending is not None

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """The robots of each process that has programs; none if there is one."""
        return ()

    @property
    def time_s(self) -> float:
        """The time in seconds at which the open round began."""
        return self.engine.round * self.scene.delta_s

    @property
    def recording(self) -> RunLog:
        return self.recorder.recording

    @uncollected()
    def begin(self) -> Decision:
        """Run INIT."""
        decision = self.decision = self.engine.begin()
        self.observer.begun(decision)
        self._note(decision)
        self._look(WatchPoint.BEGUN)
        self._conclude()
        return decision

    def round(self) -> Decision:
        """Run a round: the robots' events, then the environment's turn, δ long."""
        self.act()
        return self.finish()

    def act(self) -> Decision:
        """Run the robots' events of a round."""
        engine = self.engine
        decision = self.decision = engine.program_turns(self.schedule)
        self.acted.update([taken.robot for taken in decision.ran])
        deeds = self._deeds = deeds_in(decision, engine)
        self.observer.round(decision.round, deeds)
        self.gauge.events(decision, deeds)
        self._note(decision)
        if engine.ended is None:
            self._look(WatchPoint.EVENTS)
        return decision

    def finish(self) -> Decision:
        """End the round in which robots have acted: the environment's turn."""
        engine, decision = self.engine, self.decision
        if engine.ended is None:
            self.pass_time()
            self.environment_turn()
            stopped = self._stopped(decision, self._deeds)
            self.gauge.round(self.host.sensed, stopped)
            if engine.ended is None:
                self._watch_over(stopped)
                self._look(WatchPoint.ROUND)
        self._conclude(ran=bool(decision.ran))
        return decision

    def stride(self, until_s: float) -> list[Decision]:
        """Make rounds up to a time, in all of which but the first nobody acts, if there are any.

        They come to the same as rounds that are made one by one.
        """
        if self._strides is None:
            if self.striding is None or not self.engine.is_idle(self.decision):
                return []
            self._strides = self.striding(self)
            self.striding = None
        return [] if self._strides is None else self._strides.make(until_s)

    def pass_idle(self, decisions: Sequence[Decision], places: Sequence[Floats]) -> None:
        """Note rounds; ``places`` are where robots were at the begin of those behind the first.

        In these nobody acted. The first has been noted, if there is no place for it; in all but the
        last somebody was on the way.
        """
        rounds, idle = len(decisions), len(places)
        self.decision = decisions[-1]
        if idle:
            self._digest.pass_idle(decisions[rounds - idle].round, places)
        if rounds > 1:
            self._still, self._before = 0, None
        self._conclude(ran=bool(self.decision.ran))

    def environment_turn(self) -> None:
        """Let robots sense what has become of the world."""
        self.engine.environment_turn()

    def pass_time(self) -> None:
        """Let δ pass in the world, under the robots' orders."""
        until_s = (self.engine.round + 1) * self.scene.delta_s
        self.host.pass_time(self.robots_with_orders(), until_s, self.tick, self)

    def robots_with_orders(self) -> Sequence[Robot]:
        """The robots whose orders may be others than before; now that somebody knows, none."""
        if self.engine.has_models or self.host.modules:
            robots: Sequence[Robot] = self.engine.robots
        else:
            told = self.engine.told_robots
            robots = [told[pid] for pid in sorted(self.acted)]
        self.acted.clear()
        return robots

    def end(self, ending: Ending) -> None:
        """End the run; nothing comes after this."""
        self.ending = ending
        self.fleet.close()
        if ending is not Ending.PLAYED:
            self.standing = self.watchman.standing(self.engine.robots, _STILL_S)
        for one in self.standing:
            if one.robot not in {known.robot for known in self.noticed}:
                self._notice(one)
        more = f"; {still_words(len(self.standing))}" if self.standing else ""
        self.observer.end(ending.value + more)

    def figures(self) -> Figures:
        """The metrics of the run."""
        return self.gauge.figures(self.digest)

    @property
    def digest(self) -> str:
        """The hash of the run so far."""
        return self._digest.hexdigest()

    @property
    def looked(self) -> dict[str, int]:
        """The number of checks of each claim."""
        found = dict(self._earlier)
        for claims in self.claims:
            for name, count in claims.looked.items():
                found[name] = self._earlier.get(name, 0) + count
        return found

    @property
    def fault(self) -> Ended | None:
        return self.engine.ended

    def tick(self, fleet: Fleet) -> None:
        """Record the end of a tick of the fleet."""
        here = fleet.positions()
        near = self.gauge.tick(fleet.now_s, here)
        self.observer.tick(fleet, near.distance_m if near is not None else float("nan"))
        self._hold_apart(near, fleet.now_s, here)
        for claims in self.claims:
            for broken in claims.glance(self):
                self._break(broken)

    def is_looked_at(self, time_s: float) -> bool:
        """Return whether poses are recorded at a tick, or claims are checked."""
        return self.recorder.is_due(time_s) or any(claims.glances for claims in self.claims)

    def passed(self, time_s: float, positions: Floats) -> None:
        """Record the end of a tick at which nothing but positions is of interest."""
        self._hold_apart(self.gauge.tick(time_s, positions), time_s, positions)

    # --- another program ------------------------------------------------------------------------

    @uncollected()
    def reload(self, program: NextProgram, resume: Callable[[Engine], Resumed]) -> None:
        """Go on with another program between two rounds; what it claims is looked at. [RELOAD]

        ``resume`` says, of the engine of that program, what its robots hold; if it raises an
        error, the run is as before.
        """
        cast, host = program.cast, self.host
        were = host.classes, host.watches, self.claims_host, self.reader
        host.take_on(cast.classes)
        try:
            engine = self._engine(cast, program.heard, program.supplied)
            engine.resume(resume(engine))
        except BaseException:
            host.take_on(were[0])
            _, host.watches, self.claims_host, self.reader = were
            raise
        self.cast, self.engine, self.striding, self._strides = cast, engine, None, None
        log, header = self.recorder.recording, header_in(cast, self.scene)
        had = declared_in(log)
        whole, numbering = extended(log.header, header)
        entry = LoggedReload(
            engine.round, self.time_s, cast.text, program.words, had, numbering.declared
        )
        self.recorder.reload(whole, entry)
        self.observer.reload(engine, header, numbering)
        self.gauge.reload(engine)
        self._digest.reload(engine.round, cast.text)
        self._earlier, self._told = self.looked, {key for key in self._told if key[0] == _APART}
        self.claims[:] = program.claims(self)
        self._own = [_own_variables(one) for one in cast.classes]
        self.acted, self._before, self._still = set(range(len(cast.kinds))), None, 0
        self._look(WatchPoint.RELOADED)
        self._conclude()

    def refuse(self, words: tuple[str, ...]) -> None:
        """Record that an edited program was refused; the run goes on as it is."""
        log = self.recorder.recording
        had = declared_in(log)
        entry = LoggedReload(self.engine.round, self.time_s, None, words, had, had)
        self.recorder.reload(log.header, entry)

    # --- inside ---------------------------------------------------------------------------------

    def _engine(
        self,
        cast: Cast,
        heard: Callable[[Host], Host] | None,
        supplied: Callable[[Host], Host] | None,
    ) -> Engine:
        """The engine of a program, whose host asks the world's."""
        world: Host = self.host if supplied is None else supplied(self.host)
        self.claims_host = world
        host = world if heard is None else heard(world)
        self.reader = Reader(self.host) if host is self.host else None
        engine = self._make_engine(cast, self.scene.delta_s, self.watchman.hear(host))
        if self.reader is not None:
            engine.reader = self.reader.read
        return engine

    def _hold_apart(self, near: Nearest | None, time_s: float, positions: Floats) -> None:
        """Report robots that are nearer to each other than is safe."""
        if near is not None and near.distance_m < self.scene.safety_m:
            words = f"{near.distance_m:.3f} m apart, less than {self.scene.safety_m:.3f} m"
            place: Point = tuple(positions[near.one].tolist())
            pair = (near.one, near.other)
            self._break(BrokenClaim(_APART, time_s, pair, place, words))

    def _stopped(self, decision: Decision, deeds: Deeds) -> Bools:
        """A mask of the robots that have stopped by the end of a round."""
        if self.engine.is_idle(decision):
            return self._nobody
        stopped: Bools = deeds == Idle.STOPPED
        for taken in decision.ran:
            stopped[taken.robot] = self.engine.told_robots[taken.robot].status is Status.STOPPED
        return stopped

    def _watch_over(self, stopped: Bools) -> None:
        ended_s = self.time_s
        began_s = ended_s - self.scene.delta_s
        places, touched = self.fleet.positions(), self.fleet.touched
        for one in self.watchman.round(
            began_s, ended_s, self.host.sensed, stopped, places, touched
        ):
            self._notice(one)

    def _notice(self, one: StandingRobot) -> None:
        self.noticed.append(one)
        self.recorder.standing(self.time_s, one.robot, one.since_s, one.words)

    def _look(self, moment: WatchPoint) -> None:
        for claims in self.claims:
            for broken in claims.look(moment, self):
                self._break(broken)

    def _break(self, broken: BrokenClaim) -> None:
        """Report broken claims; one that stays broken for the same robots is reported once."""
        key = (broken.claim, broken.robots)
        if key in self._told:
            return
        self._told.add(key)
        self.broken.append(broken)
        self.recorder.violation(
            broken.time_s, broken.claim, broken.words, broken.robots, broken.place
        )

    def _note(self, decision: Decision) -> None:
        self._digest.note(decision)
        self._digest.place(self.fleet.positions())

    def _conclude(self, *, ran: bool = True) -> None:
        """End the run if it is over; ``ran`` says whether a robot has run an event."""
        if self.ending is not None:
            return
        if self.engine.ended is not None:
            self.end(Ending.FAULT)
        elif self.broken and not self.keep_going:
            self.end(Ending.VIOLATED)
        elif self.engine.all_stopped:
            self.end(Ending.STOPPED)
        elif self._is_still(ran):
            self.end(Ending.STILL)

    def _is_still(self, ran: bool) -> bool:
        """Return whether nobody moves, and no variable but measurements has changed for a while."""
        if self.waits:
            return False
        if self.watchman.sees_some_go or self.host.sensed.on_the_way.any():
            self._still, self._before = 0, None
            return False
        if self._before is not None and not (ran or self.engine.has_models):
            self._still += 1
        else:
            now = self._variables()
            self._still = self._still + 1 if now == self._before else 0
            self._before = now
        return self._still * self.scene.delta_s >= _STILL_S

    def _variables(self) -> tuple[Any, ...]:
        """The status of each robot, and all variables but measurements."""
        engine = self.engine
        # What they share they all have from the store, if they have been told.
        robots = engine.told_robots
        own = [self._own[robot.KIND](vars(robot)) for robot in robots]
        return [robot.status for robot in robots], own, dict(engine.store.values)


def _watchman(fleet: Fleet) -> type[Watchman]:
    if not fleet.is_compiled:
        return Watchman
    from koord.sim.standing_kernel import CompiledWatchman

    return CompiledWatchman


def still_words(count: int) -> str:
    """Describe how many robots stand still."""
    return f"{count} robot{' stands' if count == 1 else 's stand'} still that should go"


def _own_variables(program: type[Robot]) -> Callable[[dict[str, Any]], Any]:
    """What fetches the robot's own variables but measurements from its attributes."""
    names = [*program.LOCALS, *(name for name in program.PORTS if name not in program.SENSORS)]
    return itemgetter(*names) if names else len


def run(simulation: Simulation, time_s: float) -> Iterator[Decision]:
    """Run on up to a time, and yield each round's decision."""
    with uncollected():
        while simulation.ending is None:
            if simulation.time_s > time_s - 1e-9:
                simulation.end(Ending.LIMIT)
                break
            if made := simulation.stride(time_s):
                for decision in made:
                    yield decision
                    if simulation.is_over:
                        return
                continue
            try:
                decision = simulation.round()
            except SilentError:
                simulation.end(Ending.SILENT)
                break
            yield decision


def engine_of(cast: Cast, delta_s: float, host: Host) -> Engine:
    """The engine of a run: by machine code, if there is to be some."""
    if cast.turns is None:
        return Engine(cast.classes, cast.kinds, delta_s, host)
    return ColumnEngine(cast.classes, cast.kinds, delta_s, host, cast.turns)


def host_of(cast: Cast, scene: Scene, fleet: Fleet) -> Hosted:
    """The host of a run, with a library that plans as the robots' planners do."""
    made = {
        model: planner(model.planner, scene.world, model.body, model.effort)
        for model in dict.fromkeys(placed.model for placed in scene.robots)
    }
    planners = {pid: made[placed.model] for pid, placed in enumerate(scene.robots)}

    library = library_of(scene, planners, lambda robot: host.sensed[robot], _KEPT_ROUNDS)
    scanners = {
        robot: Scanner(lidar, scene.world, scene.robots[robot].start[2])
        for robot, lidar in scene.scanners.items()
    }
    host = Hosted(cast.classes, cast.kinds, fleet, library, scene.seed, scanners, scene.radio)
    host.ignoring_height = frozenset(
        pid for pid, placed in enumerate(scene.robots) if placed.model.ignores_height
    )
    for pid, placed in enumerate(scene.robots):
        model = placed.model
        if model.modules:
            from koord.runtime.plugins.loading import served_modules

            host.modules[pid] = served_modules(
                model.modules, pid, scene.world, model.body, scene.seed, is_simulated=True
            )
    return host
