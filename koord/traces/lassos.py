"""The judge of lassos: a lasso has to close, to be fair, and to break the stated property.

It judges by the configurations that the reference semantics gave, rule by rule. Nothing here knows
how the run was found. [LASSO]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import EXACT, Constant, Domain
from koord.semantics.liveness import LIVENESS, Response, expected, locks_of, responses
from koord.semantics.oracle import NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Recording, Round
from koord.semantics.storage import Storage
from koord.semantics.turns import guard_of
from koord.syntax import core
from koord.syntax.analysis.auxiliary import Var, auxiliary
from koord.syntax.core import Home
from koord.syntax.system import Status, System
from koord.syntax.walk import asks
from koord.traces.changes import differences
from koord.traces.enumeration import ExploringInputs, UnboundedError, explored
from koord.traces.names import Names


class Flaw(Struct, frozen=True):
    """A reason why a lasso is rejected, and the rule that it breaks."""

    rule: str
    reason: str


def flaw_of(
    system: System,
    recording: Recording,
    configurations: Sequence[Configuration[Constant]],
    stated: core.Property | None,
    d: Domain[Constant] = EXACT,
) -> Flaw | None:
    """The first flaw of a lasso, or None if the rules accept it.

    ``configurations`` are those of the recorded run, on the numbers of ``d``: the one after INIT
    and one after each round. ``stated`` is the property that it is to break, if any.
    """
    assert recording.loop is not None
    return next(_flaws(Lasso(system, recording, tuple(configurations), d), stated), None)


class Lasso(Struct, frozen=True):
    """A lasso with its configurations, one more than there are rounds."""

    system: System
    recording: Recording
    configurations: tuple[Configuration[Constant], ...]
    d: Domain[Constant] = EXACT

    @property
    def begins(self) -> int:
        assert self.recording.loop is not None
        return self.recording.loop

    @property
    def rounds(self) -> list[tuple[Configuration[Constant], Round]]:
        """The rounds of the loop, each with the configuration that it starts from."""
        pairs = zip(self.configurations, self.recording.rounds, strict=False)
        return list(pairs)[self.begins :]

    @property
    def repeated(self) -> range:
        """The configurations of the loop."""
        return range(self.begins + 1, len(self.configurations))


def _flaws(lasso: Lasso, stated: core.Property | None) -> Iterator[Flaw]:
    yield from _shape(lasso, stated)
    if stated is not None:
        yield from _unbroken(lasso, stated)
    yield from _unfair(lasso)


def _shape(lasso: Lasso, stated: core.Property | None) -> Iterator[Flaw]:
    """Yield a flaw unless rounds are whole and the loop closes. [LIVE-RUN] [AUXILIARY]"""
    recording, configurations = lasso.recording, lasso.configurations
    if not 0 <= lasso.begins < len(recording.rounds):
        yield Flaw("LASSO", f"the loop begins in round {lasso.begins + 1}, which there is not")
        return
    whole = len(configurations) == len(recording.rounds) + 1
    if not whole or any(round_.cut for round_ in recording.rounds):
        yield Flaw("LIVE-RUN", "a run without end has whole rounds only")
        return
    first, last = configurations[lasso.begins], configurations[-1]
    if first.fault is not None or last.fault is not None:
        yield Flaw("LIVE-RUN", "a run without end does not fault")
        return
    names = Names(lasso.system)
    found = list(islice(differences(names, _timeless(first), _timeless(last)), 3))
    if found:
        # It is looked for only now: most loops come back to everything.
        spared = auxiliary(lasso.system, () if stated is None else (stated,))
        back = with_those_of(last, first, spared)
        found = list(islice(differences(names, _timeless(first), _timeless(back)), 3))
    if found:
        told = ", ".join(f"{change.name}: {change.old} and {change.new}" for change in found)
        yield Flaw("LASSO", f"the run does not end where its loop begins ({told})")


def left_behind(
    system: System, first: Configuration[Constant], last: Configuration[Constant]
) -> tuple[str, ...]:
    """The places of auxiliary variables that differ between the loop's start and its end.
    [AUXILIARY]
    """
    found = differences(Names(system), _timeless(first), _timeless(last))
    return tuple(dict.fromkeys(change.name for change in found))


def _timeless(configuration: Configuration[Constant]) -> Configuration[Constant]:
    """The configuration without the parts that no later round depends on."""
    robots = tuple(replace(robot, ran=NO_EVENT) for robot in configuration.robots)
    return replace(configuration, robots=robots, round=0)


# --- the property ---------------------------------------------------------------------------------


def rule_of(stated: core.Property) -> str:
    """The rule of a property of runs without end."""
    return "PROP-EVENTUALLY" if stated.trigger is None else "PROP-LEADS-TO"


def _unbroken(lasso: Lasso, stated: core.Property) -> Iterator[Flaw]:
    """Yield a flaw unless the lasso breaks the property, of some robot if it is about each.
    [PROP-LEADS-TO]
    """
    rule = rule_of(stated)
    if stated.kind not in LIVENESS:
        yield Flaw(rule, f"{stated.name} is not about runs without end")
    elif _is_open(lasso.system, stated):
        yield Flaw(rule, f"{stated.name} asks what an external function gives")
    elif not any(breaks(lasso, response) for response in responses(lasso.system, stated)):
        yield Flaw(rule, f"{stated.name} is not broken by the run")


def broken_by(
    system: System,
    recording: Recording,
    configurations: Sequence[Configuration[Constant]],
    stated: core.Property,
) -> tuple[Response, int] | None:
    """The first response that a lasso breaks, and the configuration from which it does."""
    lasso = Lasso(system, recording, tuple(configurations))
    for response in responses(system, stated):
        since = _since(lasso, response)
        if since is not None:
            return response, since
    return None


def breaks(lasso: Lasso, response: Response) -> bool:
    """Return whether a trigger occurs that the goal never follows."""
    return _since(lasso, response) is not None


def _since(lasso: Lasso, response: Response) -> int | None:
    """The first configuration with the trigger that the goal never follows, or None."""
    met = [holds_at(lasso, response.goal, n) for n in range(len(lasso.configurations))]
    if any(met[n] for n in lasso.repeated):
        return None
    last = max((n for n, holds in enumerate(met) if holds), default=-1)
    if response.trigger is None:
        return 0 if last < 0 else None
    after = range(last + 1, len(met))
    return next((n for n in after if holds_at(lasso, response.trigger, n)), None)


def holds_at(lasso: Lasso, statement: core.Property, number: int) -> bool:
    configuration = lasso.configurations[number]
    holds, _ = holds_in(
        lasso.d, lasso.system, configuration, statement.condition, statement.bound, NoInputs()
    )
    return holds is True


def _is_open(system: System, stated: core.Property) -> bool:
    sides = [stated.condition, *([stated.trigger] if stated.trigger is not None else [])]
    return any(asks(system.program, side) for side in sides)


# --- fairness -------------------------------------------------------------------------------------


def _unfair(lasso: Lasso) -> Iterator[Flaw]:
    system = lasso.system
    able = [
        [able_in(system, start, robot, lasso.d) for robot in range(system.robots)]
        for start, _ in lasso.rounds
    ]
    for robot in range(system.robots):
        pairs = zip(lasso.rounds, able, strict=True)
        if all(here[robot].ready and not ran(round_, robot) for (_, round_), here in pairs):
            yield Flaw("FAIR-ROBOT", f"robot {robot} could run an event, and never does")
    for robot, k in locks_of(system):
        asked = any(here[robot].asks_for(k) for here in able)
        if asked and not any(k in classes_of(system, round_, robot) for _, round_ in lasso.rounds):
            variables = ", ".join(system.program.lock_classes[k].variables) or f"class {k}"
            yield Flaw("FAIR-LOCK", f"robot {robot} asks for the lock of {variables} in vain")
    for stated in system.program.expectations:
        if _is_open(system, stated):
            yield Flaw("FAIR-ASSUME", f"{stated.name} asks what an external function gives")
    for response in expected(system):
        if breaks(lasso, response):
            whose = "" if response.robot is None else f", of robot {response.robot}"
            yield Flaw("FAIR-ASSUME", f"the run does not do what {response.name} expects{whose}")


class Able(Struct, frozen=True):
    """The moves open to a robot in a configuration, and the lock classes of its enabled events.

    Where the answers that a guard may get are too many to try them, a robot counts as ready, and as
    asking for what its other events ask for: so nothing counts as fair that may not be.
    """

    ready: bool
    classes: tuple[frozenset[int], ...]
    events: tuple[bool, ...] = ()  #: whether each event is one of them

    def asks_for(self, k: int) -> bool:
        return self.ready and all(k in each for each in self.classes)


def able_in(
    system: System,
    configuration: Configuration[Constant],
    robot: int,
    d: Domain[Constant] = EXACT,
) -> Able:
    """Find the events that a robot may run in a configuration. [FAIR-ROBOT] [FAIR-LOCK]"""
    state = configuration.robots[robot]
    if state.status == Status.STOPPED:
        return Able(False, (), (False,) * len(system.agent(robot).events))
    ready = False
    classes: list[frozenset[int]] = []
    open_: list[bool] = []
    for event in system.agent(robot).events:
        try:
            found = _guard(d, system, configuration, robot, event)
        except UnboundedError:
            ready = True
            open_.append(True)
            continue
        ready |= all(holds for holds, _ in found)
        open_.append(any(holds or not sound for holds, sound in found))
        if open_[-1]:
            classes.append(event.lock_classes)
    return Able(ready, tuple(classes), tuple(open_))


def _guard(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    robot: int,
    event: core.Event,
) -> list[tuple[bool, bool]]:
    """For each answer, whether a guard holds, and whether it evaluates without a fault."""
    state = configuration.robots[robot]
    turns = explored(
        lambda chooser: ExploringInputs(system, chooser),
        lambda inputs: guard_of(d, system, robot, state, event, inputs),
    )
    return [(turn.outcome[0] is True, turn.outcome[1] is True) for turn in turns]


def ran(round_: Round, robot: int) -> bool:
    return round_.events[robot] is not None


def classes_of(system: System, round_: Round, robot: int) -> frozenset[int]:
    position = round_.events[robot]
    if position is None:
        return frozenset()
    return system.agent(robot).events[position].lock_classes


def with_those_of(
    configuration: Configuration[Constant],
    other: Configuration[Constant],
    variables: frozenset[Var],
) -> Configuration[Constant]:
    """The configuration with some variables set to their values in another one."""

    def of(
        home: Home,
        kind: int | None,
        mine: tuple[Storage[Constant], ...],
        its: tuple[Storage[Constant], ...],
    ) -> tuple[Storage[Constant], ...]:
        pairs = enumerate(zip(mine, its, strict=True))
        return tuple(b if Var(home, kind, slot) in variables else a for slot, (a, b) in pairs)

    def store(mine: Store[Constant], its: Store[Constant]) -> Store[Constant]:
        return Store(
            of(Home.ALLREAD, None, mine.allread, its.allread),
            of(Home.ALLWRITE, None, mine.allwrite, its.allwrite),
        )

    def robot(mine: Robot[Constant], its: Robot[Constant]) -> Robot[Constant]:
        return replace(
            mine,
            locals=of(Home.LOCAL, mine.kind, mine.locals, its.locals),
            ports=of(Home.PORT, mine.kind, mine.ports, its.ports),
            copy=store(mine.copy, its.copy),
        )

    pairs = zip(configuration.robots, other.robots, strict=True)
    return replace(
        configuration,
        robots=tuple(robot(mine, its) for mine, its in pairs),
        store=store(configuration.store, other.store),
    )
