"""Text of whole rounds: schedule, guards, events, models and claims in one function. [SELECT]"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from koord.sampling.compiled.claims import Splitting, WrittenPart
from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.halts import Schedule, Stage
from koord.sampling.compiled.round_claims import Claims
from koord.sampling.compiled.round_log import Columns
from koord.sampling.compiled.round_turns import (
    UNWRITTEN,
    EnvironmentText,
    EventText,
    guards_text,
)
from koord.sampling.compiled.state import State, StateColumn
from koord.sampling.compiled.statements import INDENT
from koord.semantics.configurations import NO_EVENT, Written
from koord.syntax.core import Home

_DOUBTS = "except (InDoubt, ArithmeticError):"


class RoundText:
    """The text of functions on a state; ``columns`` are those that turns write.

    The functions are ``play``, which makes a round, and ``end`` and ``holds``, which look at
    claims. They log turns in ``log``, models in ``env_log``, and ask those in ``ask_prog`` and
    ``ask_env``, by robot. Raises NoCodeError.
    """

    def __init__(self, state: State, schedule: Schedule, claims: Claims) -> None:
        self._system = system = state.system
        self._state = state
        self.names = Names(state.d, system)
        self.names.values |= {
            "spend": system.budget.spend,
            "Written": Written,
            "UNWRITTEN": UNWRITTEN,
            "ran": state.ran.values,
            "status": state.status.values,
            "none_ran": [NO_EVENT] * system.robots,
            "nobody": frozenset(),
        }
        self._events: dict[tuple[int, int], EventText] = {}
        self._environments: dict[int, EnvironmentText] | None = {}
        self._guards: dict[int, str] = {}
        self._kinds = sorted(set(system.kinds))
        splitting = Splitting(state, self.names, unit=state.unit, short=True, spends=False)
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
            f"{two}lost, picked = None, event",
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
        halted = f"return {int(Stage.CLAIMS)}, pid, picked"
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
