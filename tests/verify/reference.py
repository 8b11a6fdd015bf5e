"""Every run of a small system, one turn at a time: what the engines' verdicts are measured by.

Naive on purpose: all orders, all events, all skips, all answers, by the sequential rules alone. It
shares with the engines the rules of a single step, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import permutations, product
from typing import TypeAlias, TypeVar

from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Turn
from koord.semantics.domain import EXACT, Constant
from koord.semantics.environment import environment_turn
from koord.semantics.locations import Mask
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Concrete
from koord.semantics.rounds import IllegalStepError, initialised, run_event, run_skip
from koord.semantics.storage import Storage
from koord.semantics.turns import program_turn
from koord.semantics.values import Rec, Seq
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind
from koord.syntax.system import Status, System
from koord.syntax.types import (
    INT,
    ArrayType,
    BoolType,
    EnumType,
    ListType,
    RecordType,
    Robots,
    Type,
)
from koord.syntax.walk import nodes, statements
from koord.verify.claims import ClaimKind, claims_of

T = TypeVar("T")
Exactly: TypeAlias = "Configuration[Constant]"

#: Integers that are left open are tried from the one to the other; neither may be legal.
LEAST, MOST = -1, 3


class TooManyError(Exception):
    """The system is not small."""


# --- what is left open ----------------------------------------------------------------------------


@dataclass(slots=True)
class Answers:
    """Inputs of one step. Each time the step is run again, the next untried values are given."""

    system: System
    path: list[tuple[int, int]] = field(default_factory=list)
    depth: int = 0
    given: dict[object, Concrete] = field(default_factory=dict)

    def restart(self) -> bool:
        """Go on to the next values; whether there are any."""
        del self.path[self.depth :]
        while self.path and self.path[-1][0] + 1 == self.path[-1][1]:
            self.path.pop()
        self.depth, self.given = 0, {}
        if not self.path:
            return False
        position, count = self.path[-1]
        self.path[-1] = (position + 1, count)
        return True

    def pick(self, question: object, values: list[Concrete]) -> Concrete:
        if question in self.given:
            return self.given[question]
        if self.depth == len(self.path):
            self.path.append((0, len(values)))
        position, _ = self.path[self.depth]
        self.depth += 1
        self.given[question] = values[position]
        return values[position]

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        values = every(type_, self.system.robots, declaration.length)
        return self.pick(("start", variable, robot), values)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        return self.pick(("sensor", variable, robot), every(variable.type, self.system.robots))

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return Asked(self, phase, robot)

    def at_the_edge(self) -> bool:
        """Whether an integer was tried behind which others may be legal too."""
        numbers = [n for value in self.given.values() for n in _numbers(value)]
        return LEAST in numbers or MOST in numbers


@dataclass(slots=True)
class Asked:
    """An oracle that gives every answer in turn."""

    answers: Answers
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        values: list[Concrete] = [low]
        if type_ == INT:
            assert isinstance(low, int)
            assert isinstance(high, int)
            if low < LEAST + 1 or high > MOST - 1:
                raise TooManyError("a choice among many")
            values = [*range(low, max(low, high) + 1)]
        elif low != high:
            raise TooManyError("a choice among reals")
        chosen = self.answers.pick((self.phase, self.robot, key), values)
        assert isinstance(chosen, Constant)
        return chosen

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        if function.kind is core.ExternalKind.FUNCTION:
            raise TooManyError("a mathematical function")
        values = every(function.result.type, self.answers.system.robots)
        return self.answers.pick((self.phase, self.robot, key), values)

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        raise TooManyError("a statement about all values of a type")

    def vouches_for(self, function: core.External) -> bool:
        return False


def every(type_: Type, robots: int, length: int | None = None) -> list[Concrete]:
    """All values of a type; of integers, those that may be legal in a small system."""
    match type_:
        case BoolType():
            return [False, True]
        case EnumType(members=members):
            return [*range(len(members))]
        case RecordType(fields=fields):
            return [Rec(x) for x in product(*(every(t, robots) for _, t in fields))]
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            return [Seq(count, x) for x in product(every(element, robots), repeat=count)]
        case ListType(element=element) if length is not None:
            return [Seq(length, x) for x in product(every(element, robots), repeat=length)]
        case _ if type_ == INT:
            return [*range(LEAST, MOST + 1)]
        case _:
            raise TooManyError(f"all values of {type_}")


def _numbers(value: Concrete) -> Iterator[int]:
    match value:
        case Rec(fields=parts) | Seq(items=parts):
            for part in parts:
                yield from _numbers(part)
        case bool():
            pass
        case int():
            yield value


@dataclass(slots=True)
class Budget:
    """How many steps may still be tried."""

    left: int

    def outcomes(self, system: System, step: Callable[[Answers], T]) -> Iterator[T]:
        """What a step gives for each legal way to answer it."""
        answers, more = Answers(system), True
        while more:
            if self.left == 0:
                raise TooManyError("too many steps")
            self.left -= 1
            try:
                outcome = step(answers)
            except IllegalStepError:
                pass
            else:
                if answers.at_the_edge():
                    raise TooManyError("an integer without bounds")
                yield outcome
            more = answers.restart()


# --- exploration ----------------------------------------------------------------------------------

Path: TypeAlias = "tuple[tuple[str, object], ...]"


@dataclass(frozen=True, slots=True)
class Moved:
    """A robot's event in a round, and the locations it wrote, by allwrite slot."""

    robot: int
    position: int
    wrote: frozenset[tuple[int, Path]]


@dataclass(slots=True)
class Explored:
    """What was seen: for each broken claim the first round in which it is (0: after INIT).

    ``closed`` says that no round leads anywhere new, so that all runs were seen.
    """

    first: dict[str, int] = field(default_factory=dict)
    ran: set[tuple[int, int]] = field(default_factory=set)  #: (agent kind, event)
    configurations: int = 0
    initial: int = 0
    closed: bool = False


class Explorer:
    """All runs of a system through some rounds."""

    def __init__(self, system: System, steps: int = 1000) -> None:
        self.system = system
        self.seen = Explored()
        self._budget = Budget(steps)
        self._round = 0
        self._properties = [
            claim.stated
            for claim in claims_of(system)
            if claim.kind is ClaimKind.PROPERTY and claim.stated is not None
        ]
        self._updates = updates(system.program)

    def explore(self, rounds: int) -> Explored:
        """Everything through that many rounds. Raises TooManyError if that is too much."""
        level = self._initial()
        known = set(level)
        self.seen.initial = len(level)
        for number in range(1, rounds + 1):
            self._round = number
            level = {after for start in level for after in self._round_from(start)} - known
            known |= level
            if not level:
                self.seen.closed = True
                break
        self.seen.configurations = len(known)
        return self.seen

    def _initial(self) -> set[Exactly]:
        """[INIT] [PROP-ASSUME]"""
        found = set()
        for order in permutations(range(self.system.robots)):
            for made in self._budget.outcomes(self.system, partial(self._start, order)):
                if made.fault is not None:
                    self._broken("no fault")
                else:
                    self._look(made, at_round=True)
                    found.add(made)
        return found

    def _start(self, order: tuple[int, ...], answers: Answers) -> Exactly:
        made = initialised(EXACT, self.system, answers, order).configuration
        for assumption in self.system.program.assumptions:
            e, bound = assumption.condition, assumption.bound
            if holds_in(EXACT, self.system, made, e, bound, answers)[0] is not True:
                raise IllegalStepError("PROP-ASSUME", assumption.name)
        return made

    def _round_from(self, start: Exactly) -> set[Exactly]:
        """The configurations after a round; every configuration in it is looked at."""
        ends: set[Exactly] = set()
        reached: set[tuple[Exactly, frozenset[Moved]]] = set()
        todo: list[tuple[Exactly, frozenset[Moved]]] = [(start, frozenset())]
        while todo:
            now, moved = todo.pop()
            if now.turn is Turn.ENV:
                ends.update(self._environment(now))
                continue
            for robot, state in enumerate(now.robots):
                if state.turn is Turn.ENV:
                    continue
                for after, move in self._turns(now, robot):
                    if move is not None:
                        self._meet(move, moved)
                    reaching = (after, moved | {move} if move is not None else moved)
                    if reaching not in reached:
                        reached.add(reaching)
                        self._look(after, at_round=False)
                        todo.append(reaching)
        return ends

    def _turns(self, now: Exactly, robot: int) -> Iterator[tuple[Exactly, Moved | None]]:
        """A robot's turns. Faults are noted; nothing follows them. [EVENT-TRANS] [FAULT]"""
        system = self.system
        for after in self._budget.outcomes(system, partial(_skip, system, now, robot)):
            yield after, None
        if now.robots[robot].status == Status.STOPPED:
            return
        for position in range(len(system.agent(robot).events)):
            for after, moved in self._budget.outcomes(
                system, partial(_event, system, now, robot, position)
            ):
                self.seen.ran.add((system.kinds[robot], position))
                if after.fault is not None:
                    self._broken("no fault")
                else:
                    yield after, moved

    def _environment(self, now: Exactly) -> Iterator[Exactly]:
        """Robot by robot, since their ports evolve independently. [ENV-TRANS]"""
        ways = [
            list(
                dict.fromkeys(
                    self._budget.outcomes(self.system, partial(_evolve, self.system, now, robot))
                )
            )
            for robot in range(self.system.robots)
        ]
        if not all(ways):
            return
        if any(way.faults for one in ways for way in one):
            self._broken("no fault")
        sound = [[way for way in one if not way.faults] for one in ways]
        for chosen in product(*sound):
            for way in chosen:
                for name in way.broken:
                    self._broken(f"contract {name}")
            pairs = zip(now.robots, chosen, strict=True)
            robots = tuple(
                replace(state, ports=way.ports, copy=now.store, turn=Turn.PROG)
                for state, way in pairs
            )
            after: Exactly = Configuration(robots, now.store, 0)
            self._look(after, at_round=True)
            yield after

    # --- claims -----------------------------------------------------------------------------------

    def _broken(self, name: str) -> None:
        self.seen.first.setdefault(name, self._round)

    def _look(self, now: Exactly, *, at_round: bool) -> None:
        """[PROP-INVARIANT] [PROP-ROUND]: what is claimed must hold for all answers."""
        for stated in self._properties:
            if stated.kind is PropertyKind.AT_ROUND and not at_round:
                continue
            if stated.name not in self.seen.first:
                held = self._budget.outcomes(self.system, partial(_holds, self.system, now, stated))
                if not all(x is True for x in held):
                    self._broken(stated.name)

    def _meet(self, late: Moved, others: frozenset[Moved]) -> None:
        """Which updates are lost between who moves last and who moved before. [LOST-UPDATE]"""
        program, kinds = self.system.program, self.system.kinds
        for early in others:
            met = {
                slot
                for slot, path in late.wrote
                for other, its_path in early.wrote
                if slot == other and _prefix(path, its_path)
            }
            for slot in met:
                if any(slot in self._updates[kinds[m.robot], m.position] for m in (late, early)):
                    self._broken(f"no lost update of {program.allwrite[slot].variable.name}")


@dataclass(frozen=True, slots=True)
class _Way:
    """How one robot's ports may evolve."""

    ports: tuple[Storage[Constant], ...]
    faults: bool
    broken: frozenset[str]


def _skip(system: System, now: Exactly, robot: int, answers: Answers) -> Exactly:
    return run_skip(EXACT, system, now, robot, answers).configuration


def _event(
    system: System, now: Exactly, robot: int, position: int, answers: Answers
) -> tuple[Exactly, Moved]:
    after = run_event(EXACT, system, now, robot, position, answers).configuration
    _, turned = program_turn(EXACT, system, robot, now.robots[robot], position, answers)
    wrote = {(slot, path) for slot, mask in turned.allwrite.items() for path in _paths(mask)}
    return after, Moved(robot, position, frozenset(wrote))


def _evolve(system: System, now: Exactly, robot: int, answers: Answers) -> _Way:
    turned = environment_turn(EXACT, system, robot, now.robots[robot], answers)
    for needed in turned.legality:
        if needed.condition is not True:
            raise IllegalStepError(needed.rule, needed.what)
    broken = frozenset(contract.name for kept, contract in turned.promises if kept is not True)
    return _Way(turned.ports, any(fault is True for fault, _ in turned.faults), broken)


def _holds(system: System, now: Exactly, stated: core.Property, answers: Answers) -> Constant:
    return holds_in(EXACT, system, now, stated.condition, stated.bound, answers)[0]


# --- updates --------------------------------------------------------------------------------------


def updates(program: core.Program) -> dict[tuple[int, int], frozenset[int]]:
    """The allwrite slots that each event (agent kind, position) updates. [LOST-UPDATE]"""
    return {
        (kind, position): frozenset(_updated(event.effect))
        for kind, agent in enumerate(program.agents)
        for position, event in enumerate(agent.events)
    }


def _updated(effect: core.Block) -> Iterator[int]:
    given: dict[core.Variable, set[core.Variable]] = {}
    for s in statements(effect):
        for target, source in _gifts(s):
            read = {node.variable for node in nodes(source) if isinstance(node, core.Place)}
            given.setdefault(target, set()).update(read)
    for _ in given:  # no chain is longer
        for sources in given.values():
            sources.update(*[given.get(source, set()) for source in tuple(sources)])
    for s in _free(effect):
        if isinstance(s, core.Append | core.Remove | core.Pop):
            if s.place.variable.home is Home.ALLWRITE:
                yield s.place.variable.slot
            if isinstance(s, core.Pop) and s.into is not None and _inside_entry(s.into):
                yield s.into.variable.slot
        elif isinstance(s, core.Assign) and s.place.variable.home is Home.ALLWRITE:
            read = {node.variable for node in nodes(s.value) if isinstance(node, core.Place)}
            sources = read.union(*[given.get(v, set()) for v in read])
            if s.place.variable in sources or _inside_entry(s.place):
                yield s.place.variable.slot


def _inside_entry(place: core.Place) -> bool:
    before_last = place.steps[: len(place.steps) - 1]
    shared = place.variable.home is Home.ALLWRITE
    return shared and core.KeyStep in map(type, before_last)


def _gifts(s: core.Stmt) -> Iterator[tuple[core.Variable, core.Expr | core.Place]]:
    if isinstance(s, core.Assign | core.Append):
        yield s.place.variable, s.value
    elif isinstance(s, core.Pop) and s.into is not None:
        yield s.into.variable, s.place
    elif isinstance(s, core.ForEach):
        yield s.value, s.sequence
        if s.key is not None:
            yield s.key, s.sequence


def _free(block: core.Block) -> Iterator[core.Stmt]:
    for s in block:
        yield s
        if isinstance(s, core.If):
            yield from _free((*s.then, *s.otherwise))
        elif isinstance(s, core.ForRange | core.ForEach):
            yield from _free(s.body)


def _paths(mask: Mask[Constant] | None) -> Iterator[Path]:
    """The locations that a mask says were written."""
    if mask is None:
        return
    if mask.whole is True:
        yield ()
    for position, part in enumerate(mask.parts):
        for below in _paths(part):
            yield (("part", position), *below)
    for condition, key in mask.keys:
        if condition is True:
            yield (("key", key),)


def _prefix(one: Path, other: Path) -> bool:
    """Whether one location lies in the other. [LOCATION]"""
    shared = min(len(one), len(other))
    return one[:shared] == other[:shared]
