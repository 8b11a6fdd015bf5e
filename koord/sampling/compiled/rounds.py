"""Whole rounds as code: the schedule, guards, events, models and claims in one function. [SELECT]

A round is made as far as nothing is in doubt. What was done by then stands, and the rules go on
from there: it is said at which stage the round halted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum, IntEnum
from random import Random
from typing import Any, NamedTuple

from koord.sampling.compiled.asking import Asking
from koord.sampling.compiled.claims import Splitting, WrittenPart, unit_of
from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.operations import InDoubt
from koord.sampling.compiled.round_claims import Claims
from koord.sampling.compiled.round_log import Columns, LoggedState, RoundLog
from koord.sampling.compiled.round_turns import (
    UNWRITTEN,
    EnvironmentText,
    EventText,
    guards_text,
)
from koord.sampling.compiled.state import State, StateColumn
from koord.sampling.compiled.statements import INDENT
from koord.semantics.configurations import NO_EVENT, Configuration, Written
from koord.semantics.domain import Constant, Domain
from koord.semantics.oracle import Inputs, Phase
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status, System


class Schedule(Enum):
    """How robots move."""

    IN_ORDER = "in order"
    AT_RANDOM = "at random"


class Stage(IntEnum):
    """How far a round was made."""

    WHOLE = 0
    GUARDS = 1  #: up to a robot that was picked, and whose guards are in doubt
    EVENT = 2  #: up to an event that was picked, and is in doubt
    CLAIMS = 3  #: through a turn after which not all claims hold, as far as code can tell
    ENVIRONMENT = 4  #: through the program turns; some model is in doubt
    SENSING = 5  #: through the program turns; sensors without a model are to be read
    END = 6  #: to its end, where not all claims hold, as far as code can tell


class Halt(NamedTuple):
    """Where a round halted: the stage, and the robot and the event that were picked."""

    stage: int
    robot: int
    event: int | None


class RoundCode:
    """The rounds of a system as code. Raises NoCodeError where there is none.

    ``state`` has to show a configuration between two rounds; :meth:`play` changes it.
    """

    def __init__(
        self,
        d: Domain[Constant],
        system: System,
        schedule: Schedule,
        claims: Claims,
        unit: int | None,
    ) -> None:
        self.system = system
        self.schedule = schedule
        self.claims = claims
        self.unit = unit
        self.state = State(d, system, unit)
        self._turns: list[Any] = []
        self._environment: list[Any] = []
        self.ran_before: list[int] = [NO_EVENT] * system.robots
        self._asking: dict[Phase, list[Any]] = {Phase.PROG: [], Phase.ENV: []}
        text = _Text(self, schedule, claims, unit)
        self.logged = LoggedState(self.state, text.columns)
        #: Whether the environment's turn is left to the rules.
        self.senses = text.senses
        self._values = text.names.values
        self._play: Callable[[], tuple[int, int, int | None]] = text.names.made("play")
        self._end: Callable[[], bool] = text.names.made("end")
        self._holds: Callable[[], bool] = text.names.made("holds")

    def serve(self, inputs: Inputs[Constant], rng: Random | None, skips_percent: int) -> None:
        """Ask these inputs from now on, draw by this generator, and skip so often at random."""
        for phase, asking in self._asking.items():
            asking[:] = [
                Asking(self.state.d, self.system, phase, robot, inputs)
                for robot in range(self.system.robots)
            ]
        if rng is not None:
            self._values["bits"] = rng.getrandbits
        self._values["percent"] = skips_percent

    def holds(self) -> bool:
        """Return whether code can tell that all claims hold in the state."""
        return _told(self._holds)

    def end(self) -> bool:
        """As :meth:`holds`, where only an environment's turn was taken since they did."""
        return _told(self._end)

    def seek(self, sought: Sequence[core.Expr]) -> None:
        """Look for these from now on, of all that were sought at first."""
        wanted = [f"sought_{self.claims.sought.index(one)}" for one in sought]
        self._values["sought"][:] = [self._values[name] for name in wanted]

    def play(self) -> Halt:
        """Make a round, as far as nothing is in doubt."""
        self.close()
        halt = Halt(*self._play())
        if halt.stage in (Stage.WHOLE, Stage.END):
            self.state.round += 1
        return halt

    def close(self) -> None:
        """Forget what the last round did."""
        self._turns.clear()
        self._environment.clear()
        self.ran_before[:] = self.state.ran.values

    @property
    def log(self) -> RoundLog:
        """What the last round did, if it is not closed."""
        return RoundLog(tuple(self._turns), tuple(self._environment))

    @property
    def anyone_runs(self) -> bool:
        """Return whether a robot runs events."""
        return int(Status.RUNNING) in self.state.status.values

    def undo_environment(self) -> None:
        """Undo what models did in a round that halted among them."""
        self.logged.undo(RoundLog((), tuple(self._environment)))
        self._environment.clear()

    @property
    def round(self) -> int:
        """How many rounds are over."""
        return self.state.round

    def configuration(self) -> Configuration[Constant]:
        """The configuration before what the log has."""
        return self.before(self.log, self.ran_before)

    def before(self, log: RoundLog, ran: Sequence[int]) -> Configuration[Constant]:
        """The configuration before a log that led to the present state, with what robots ran."""
        kept, number = list(self.state.ran.values), self.state.round
        self.logged.undo(log)
        self.state.ran.values[:] = ran
        if log.environment:
            self.state.round -= 1
        configuration = self.state.configuration()
        self.logged.redo(log)
        self.state.ran.values[:] = kept
        self.state.round = number
        return configuration


def _told(says: Callable[[], bool]) -> bool:
    try:
        return says()
    except (InDoubt, ArithmeticError):
        return False


def usual_unit(d: Domain[Constant], system: System) -> int | None:
    """A unit of which all constant floats of a system are whole numbers."""
    return unit_of(d, system, system.program)


# --- text ----------------------------------------------------------------------------------------

_DOUBTS = "except (InDoubt, ArithmeticError):"


class _Text:
    """The text of all functions of :class:`RoundCode`; ``columns`` are those that turns write."""

    def __init__(
        self, code: RoundCode, schedule: Schedule, claims: Claims, unit: int | None
    ) -> None:
        self._code = code
        self._system = code.system
        self._state = code.state
        self.names = Names(code.state.d, code.system)
        self.names.values |= {
            "spend": code.system.budget.spend,
            "Written": Written,
            "UNWRITTEN": UNWRITTEN,
            "log": code._turns,
            "env_log": code._environment,
            "ran": code.state.ran.values,
            "status": code.state.status.values,
            "ask_prog": code._asking[Phase.PROG],
            "ask_env": code._asking[Phase.ENV],
            "none_ran": [NO_EVENT] * code.system.robots,
            "nobody": frozenset(),
        }
        self._events: dict[tuple[int, int], EventText] = {}
        self._environments: dict[int, EnvironmentText] | None = {}
        self._guards: dict[int, str] = {}
        self._kinds = sorted(set(code.system.kinds))
        splitting = Splitting(code.state, self.names, unit=unit, short=True, spends=False)
        self._always = [part for e in claims.always for part in splitting.written(e)]
        self._at_end = [part for e in claims.between_rounds for part in splitting.written(e)]
        self._sought = [splitting.written(e) for e in claims.sought]
        for kind in self._kinds:
            self._of_kind(kind)
        self.columns = Columns(
            {key: tuple(event.columns) for key, event in self._events.items()},
            {
                kind: tuple(environment.columns)
                for kind, environment in (self._environments or {}).items()
            },
        )
        self.senses = self._environments is None
        self._checks()
        self._schedule(schedule)

    def _of_kind(self, kind: int) -> None:
        agent = self._system.program.agents[kind]
        self._guards[kind] = guards_text(self.names, self._state, kind)
        for position in range(len(agent.events)):
            self._events[kind, position] = EventText(self.names, self._state, kind, position)
        if self._environments is None:
            return
        try:
            self._environments[kind] = EnvironmentText(self.names, self._state, kind)
        except NoCodeError:
            self._environments = None

    def _line(self, *lines: str) -> None:
        self.names.texts += lines

    # --- claims ----------------------------------------------------------------------------------

    def _checks(self) -> None:
        """Functions that look at the claims that a turn may have changed. [PROP-INVARIANT]"""
        for (kind, position), event in self._events.items():
            calls = self._calls(kind, event.columns)
            self._check(f"check_{kind}_{position}", calls, "pid")
        everything = [f"{part.of_all}()" for part in (*self._always, *self._at_end)]
        self._check("holds", [*everything, "all(one() for one in sought)"])
        self._check("first", [f"{part.of_all}()" for part in self._always if "ran" in part.axes])
        ports = {column.name for columns in self._state.ports.values() for column in columns}
        moved = [part for part in self._always if ports & part.axes.keys()]
        calls = [f"{part.of_all}()" for part in (*moved, *self._at_end)]
        if self._sought:
            calls.append("all(one() for one in sought)")
        self._check("end", calls)
        for number, parts in enumerate(self._sought):
            self._check(f"sought_{number}", [f"{part.of_all}()" for part in parts])
        self.names.values["sought"] = []

    def _check(self, name: str, calls: list[str], parameters: str = "") -> None:
        self._line(f"def {name}({parameters}):", f"{INDENT}return {' and '.join(calls) or 'True'}")

    def _calls(self, kind: int, columns: Iterable[StateColumn]) -> list[str]:
        """The calls that look at a robot's parts of the claims that read some columns."""
        calls = []
        changed = {column.name: column for column in columns}
        changed["ran"] = self._state.ran
        for part in self._always:
            read = changed.keys() & part.axes.keys()
            if any(_is_shared(changed[name]) or part.axes[name] is None for name in read):
                calls.append(f"{part.of_all}()")
                continue
            axes = sorted({axis for name in read for axis in part.axes[name] or ()})
            calls += [f"{part.of_one[axis]}(pid)" for axis in axes if self._is_at(part, axis, kind)]
        return calls

    def _is_at(self, part: WrittenPart, axis: int, kind: int) -> bool:
        return any(self._system.kinds[robot] == kind for robot in part.kinds[axis])

    # --- the schedule ----------------------------------------------------------------------------

    def _schedule(self, schedule: Schedule) -> None:
        """The function of a round."""
        robots, kinds = self._system.robots, self._system.kinds
        self._line(
            f"guards = [{', '.join(self._guards[kind] for kind in kinds)}]",
            f"events = [{', '.join(self._listed(kind, self._event) for kind in kinds)}]",
            f"checks = [{', '.join(self._listed(kind, self._check_name) for kind in kinds)}]",
        )
        self._urgent()
        self._line("def play():", f"{INDENT}spend({robots})", f"{INDENT}taken = nobody")
        if schedule is Schedule.IN_ORDER:
            self._line(f"{INDENT}for pid in range({robots}):")
            started = "pid == 0"
        else:
            self._line(f"{INDENT}waiting = list(range({robots}))")
            self._line(f"{INDENT}for count in range({robots}, 0, -1):")
            self._line(*_drawn("at", "count", 2), f"{INDENT * 2}pid = waiting.pop(at)")
            started = f"count == {robots}"
        self._turn(schedule, started)
        if self._environments is None:
            self._line(f"{INDENT}return {int(Stage.SENSING)}, -1, None")
            return
        models = [self._environments[kind].name for kind in kinds]
        self._line(f"{INDENT}try:")
        if len(set(models)) == 1:
            self._line(f"{INDENT * 2}for pid in range({robots}):")
            self._line(f"{INDENT * 3}{models[0]}(pid)")
        else:
            self._line(*(f"{INDENT * 2}{name}({pid})" for pid, name in enumerate(models)))
        self._line(f"{INDENT}{_DOUBTS}", f"{INDENT * 2}return {int(Stage.ENVIRONMENT)}, -1, None")
        self._refresh()
        self._line(
            f"{INDENT}try:",
            f"{INDENT * 2}if not end():",
            f"{INDENT * 3}return {int(Stage.END)}, -1, None",
            f"{INDENT}{_DOUBTS}",
            f"{INDENT * 2}return {int(Stage.END)}, -1, None",
            f"{INDENT}return {int(Stage.WHOLE)}, -1, None",
        )

    def _turn(self, schedule: Schedule, started: str) -> None:
        """The lines of one turn of the robot ``pid``."""
        two, three, four = INDENT * 2, INDENT * 3, INDENT * 4
        urgent = any(
            event.urgent
            for kind in self._kinds
            for event in self._system.program.agents[kind].events
        )
        may_skip = "may_skip(pid, found, taken)" if urgent else "True"
        self._line(
            f"{two}try:",
            f"{three}found = guards[pid](pid)",
            f"{two}{_DOUBTS}",
            f"{three}return {int(Stage.GUARDS)}, pid, None",
        )
        if schedule is Schedule.IN_ORDER:
            self._line(f"{two}event = found[0] if found else None")
        else:
            skips = "at < percent"
            skips += f" and {may_skip}" if urgent else ""
            self._line(
                *_drawn("at", "100", 2),
                f"{two}if not found or {skips}:",
                f"{three}event = None",
                f"{two}else:",
                *_drawn("at", "len(found)", 3),
                f"{three}event = found[at]",
            )
        self._line(
            f"{two}lost = None",
            f"{two}if event is not None:",
            f"{three}try:",
            f"{four}after = events[pid][event](pid, taken)",
            f"{three}{_DOUBTS}",
            f"{four}return {int(Stage.EVENT)}, pid, event",
            f"{three}if after is not None:",
            f"{four}taken = after",
            f"{three}elif {may_skip}:",
            f"{four}lost, event = event, None",
            f"{three}else:",
            f"{four}return {int(Stage.EVENT)}, pid, event",
            f"{two}if {started}:",
            f"{three}ran[:] = none_ran",
            f"{two}if event is None:",
            f"{three}log.append((pid, None, lost, (), (), (), taken))",
            f"{two}else:",
            f"{three}ran[pid] = event",
        )
        halted = f"return {int(Stage.CLAIMS)}, pid, event"
        if any("ran" in part.axes for part in self._always):
            self._line(f"{two}try:", f"{three}if {started} and not first():", f"{four}{halted}")
            self._line(f"{two}{_DOUBTS}", f"{three}{halted}")
        if self._always:
            self._line(
                f"{two}if event is not None:",
                f"{three}try:",
                f"{four}if not checks[pid][event](pid):",
                f"{four}{INDENT}{halted}",
                f"{three}{_DOUBTS}",
                f"{four}{halted}",
            )

    def _urgent(self) -> None:
        """A function that says whether a robot may skip. [SKIP]"""
        program, kinds = self._system.program, self._system.kinds
        urgent = [
            {
                position: event.lock_classes
                for position, event in enumerate(program.agents[kind].events)
                if event.urgent
            }
            for kind in kinds
        ]
        self.names.values["urgent"] = urgent
        self._line(
            "def may_skip(pid, found, taken):",
            f"{INDENT}classes = urgent[pid]",
            f"{INDENT}for event in found:",
            f"{INDENT * 2}if event in classes and not classes[event] & taken:",
            f"{INDENT * 3}return False",
            f"{INDENT}return True",
        )

    def _listed(self, kind: int, name: Callable[[int, int], str]) -> str:
        count = len(self._system.program.agents[kind].events)
        return f"[{', '.join(name(kind, position) for position in range(count))}]"

    def _event(self, kind: int, position: int) -> str:
        return self._events[kind, position].name

    @staticmethod
    def _check_name(kind: int, position: int) -> str:
        return f"check_{kind}_{position}"

    def _refresh(self) -> None:
        """Everybody sees what was written. [REFRESH]"""
        written = {
            column.name: column for event in self._events.values() for column in event.columns
        }
        for column in written.values():
            if column.home in (Home.ALLREAD, Home.ALLWRITE):
                self._line(f"{INDENT}s_{column.name}[:] = {column.name}")


def _is_shared(column: StateColumn) -> bool:
    return column.home is Home.ALLWRITE


def _drawn(name: str, count: str, depth: int) -> list[str]:
    """Lines that draw a number below a count, as ``Random.choice`` and ``randrange`` do."""
    indent = INDENT * depth
    return [
        f"{indent}width = ({count}).bit_length()",
        f"{indent}{name} = bits(width)",
        f"{indent}while {name} >= {count}:",
        f"{indent}{INDENT}{name} = bits(width)",
    ]
