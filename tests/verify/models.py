"""All configurations that a formula allows, read out of its models one by one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import permutations

from koord.semantics.configurations import Configuration, Robot, Store, Turn
from koord.semantics.domain import EXACT, Constant, conjunction
from koord.semantics.recordings import RecordedInputs
from koord.semantics.rounds import IllegalStepError, initialised, run_event, run_skip
from koord.semantics.storage import Cell, Storage, Tree, same_storage, unset
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, RecordType, Robots, Type
from koord.verify.effort import Deadline
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import Model, SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.witness import ModelReader

#: What properties read of a configuration: the store, and of each robot locals, ports, status, ran.
Seen = tuple[object, ...]


def seen_by_properties(c: Configuration[Constant]) -> Seen:
    return (
        c.store,
        *((robot.locals, robot.ports, robot.status, robot.ran) for robot in c.robots),
    )


# --- by the sequential rules ----------------------------------------------------------------------


def turns(start: Configuration[Constant], system: System) -> Iterator[Configuration[Constant]]:
    """Every configuration in a round of a system that leaves nothing open. [EVENT-TRANS]"""
    nothing = RecordedInputs()
    for order in permutations(range(system.robots)):
        level = [start]
        for robot in order:
            after = []
            for now in level:
                with suppress(IllegalStepError):
                    after.append(run_skip(EXACT, system, now, robot, nothing).configuration)
                for position in range(len(system.agent(robot).events)):
                    try:
                        ran = run_event(EXACT, system, now, robot, position, nothing)
                    except IllegalStepError:
                        continue
                    if ran.configuration.fault is None:
                        after.append(ran.configuration)
            yield from after
            level = after


def first(system: System, order: tuple[int, ...] | None = None) -> Configuration[Constant]:
    return initialised(EXACT, system, RecordedInputs(), order).configuration


def ends(system: System) -> set[Seen]:
    """What properties may read at the end of the first round's program turns."""
    found = turns(first(system), system)
    return {seen_by_properties(c) for c in found if c.turn is Turn.ENV}


def anywhere(system: System) -> set[Seen]:
    """What properties may read in the first round, before the environment's turn."""
    return {seen_by_properties(c) for c in turns(first(system), system)}


def starts(system: System) -> set[Seen]:
    """What properties may read after INIT. [INIT]"""
    orders = permutations(range(system.robots))
    return {seen_by_properties(first(system, order)) for order in orders}


# --- by the formula -------------------------------------------------------------------------------


def models(unrolling: Unrolling, moment: SymbolicConfiguration, most: int = 200) -> set[Seen]:
    """What properties may read at a moment, by the solver."""
    d, system = unrolling.encoder.d, unrolling.system
    sound = d.unary(UnaryOp.NOT, moment.findings.fault)
    question = [sound, moment.real]
    found: set[Seen] = set()
    while unrolling.solver.check(question, Deadline()) is SolverAnswer.SAT:
        model = unrolling.solver.model()
        one = read(model, system, moment.configuration)
        found.add(seen_by_properties(one))
        question.append(d.unary(UnaryOp.NOT, same(unrolling, moment.configuration, one)))
        assert len(found) <= most
    return found


def ends_by_formula(system: System) -> set[Seen]:
    unrolling, middle = _first_round(system)
    return models(unrolling, middle)


def anywhere_by_formula(system: System) -> set[Seen]:
    """Both moments of a round: robots that run nothing may have moved or not. [T-PREFIX]"""
    unrolling = Unrolling(system)
    taken = unrolling.encoder.round(unrolling.opening.moment.configuration, "0")
    unrolling.solver.add(taken.middle.constraints)
    inside = models(unrolling, taken.inside) if taken.inside is not None else set()
    unrolling.solver.add(taken.urgency)
    return inside | models(unrolling, taken.middle)


def starts_by_formula(system: System) -> set[Seen]:
    unrolling = Unrolling(system)
    return models(unrolling, unrolling.opening.moment)


def _first_round(system: System) -> tuple[Unrolling, SymbolicConfiguration]:
    unrolling = Unrolling(system)
    taken = unrolling.encoder.round(unrolling.opening.moment.configuration, "0")
    unrolling.solver.add([*taken.middle.constraints, *taken.urgency])
    return unrolling, taken.middle


# --- reading configurations -----------------------------------------------------------------------


def read(model: Model, system: System, c: Configuration[Term]) -> Configuration[Constant]:
    """A configuration as a model has it. Copies are not read."""
    reader = ModelReader(model, system)
    program = system.program

    def of(storages: tuple[Storage[Term], ...], types: list[Type]) -> tuple[Storage[Constant], ...]:
        pairs = zip(storages, types, strict=True)
        return tuple(_storage(reader, storage, type_, system.robots) for storage, type_ in pairs)

    store = Store(
        of(c.store.allread, [entry.variable.type for entry in program.allread]),
        of(c.store.allwrite, [entry.variable.type for entry in program.allwrite]),
    )
    robots = []
    for number, robot in enumerate(c.robots):
        agent = system.agent(number)
        locals_ = of(robot.locals, [entry.variable.type for entry in agent.locals])
        ports = of(robot.ports, [port.declaration.variable.type for port in agent.ports])
        status, ran = model.scalar(robot.status, INT), model.scalar(robot.ran, INT)
        robots.append(Robot(robot.kind, locals_, ports, store, status, ran))
    return Configuration(tuple(robots), store, c.round)


def _storage(
    reader: ModelReader, storage: Storage[Term], type_: Type, robots: int
) -> Storage[Constant]:
    if isinstance(storage, Cell):
        if not reader.truth(storage.is_set):
            return unset(EXACT, type_, robots)
        return Cell(True, reader.value(storage.value, type_))
    if isinstance(type_, RecordType):
        types = [field for _, field in type_.fields]
    else:
        assert isinstance(type_, ArrayType)
        types = [type_.element] * (robots if type_.size is Robots.ALL else type_.size)
    pairs = zip(storage.parts, types, strict=True)
    return Tree(tuple(_storage(reader, part, t, robots) for part, t in pairs))


def same(unrolling: Unrolling, c: Configuration[Term], one: Configuration[Constant]) -> Term:
    """Whether a configuration is that one, in what properties read."""
    d = unrolling.encoder.d
    pairs: list[tuple[Storage[Term], Storage[Term]]] = [
        *zip(c.store.allread, lifted(one.store.allread), strict=True),
        *zip(c.store.allwrite, lifted(one.store.allwrite), strict=True),
    ]
    scalars: list[tuple[Term, Term]] = []
    for robot, its in zip(c.robots, one.robots, strict=True):
        pairs += zip(robot.locals, lifted(its.locals), strict=True)
        pairs += zip(robot.ports, lifted(its.ports), strict=True)
        scalars += [(robot.status, its.status), (robot.ran, its.ran)]
    # Maps are compared as lists of their entries: the order of keys is to be told apart.
    parts = [same_storage(d, listed(a), listed(b)) for a, b in pairs]
    parts += [d.binary(BinaryOp.EQ, a, b) for a, b in scalars]
    return conjunction(d, parts)


def listed(storage: Storage[Term]) -> Storage[Term]:
    """A storage with maps as lists of their entries."""
    if isinstance(storage, Tree):
        return Tree(tuple(listed(part) for part in storage.parts))
    return Cell(storage.is_set, _listed(storage.value))


def _listed(value: Value[Term]) -> Value[Term]:
    match value:
        case Rec(fields=fields):
            return Rec(tuple(map(_listed, fields)))
        case Seq(length=length, items=items):
            return Seq(length, tuple(map(_listed, items)))
        case Table(length=length, entries=entries):
            return Seq(length, tuple(Rec((_listed(k), _listed(v))) for k, v in entries))
        case _:
            return value


def lifted(storages: tuple[Storage[Constant], ...]) -> tuple[Storage[Term], ...]:
    """Constants are terms as they are."""
    return storages
