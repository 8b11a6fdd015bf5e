"""Watching a run: which property is the first to break, and after which step. [PROP-INVARIANT]

A property is looked at part by part: conjuncts, and instances of quantifiers over robots. A step
leaves most of a configuration alone, and a part that reads what it read when it last held holds
still; so of a thousand parts a step has a few looked at.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from koord.semantics.configurations import Configuration, System
from koord.semantics.domain import Constant, Domain
from koord.semantics.execution import Step
from koord.semantics.expressions import slot_in, statement
from koord.semantics.machine import machine
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.storage import Tree, held
from koord.semantics.traces.trace import Violation, ViolationKind
from koord.semantics.turns import holds_in
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, PropertyKind, QuantifierKind
from koord.syntax.walk import nodes

#: A property of more parts is looked at as a whole.
_MOST_PARTS = 10_000


@dataclass
class Watch:
    """Looks at the observed configurations of a run."""

    d: Domain[Constant]
    system: System
    inputs: Inputs[Constant]
    _parts: dict[str, list[_Part]] = field(default_factory=dict)

    def after(self, step: Step) -> Violation | None:
        """What the step broke: the first contract or property that does not hold.

        [PROP-INVARIANT] [PROP-ROUND] [PROP-CONTRACT]
        """
        if step.configuration.fault is not None:
            return None
        for robot, contract in step.stepped.promises:
            return Violation(ViolationKind.CONTRACT, contract.name, step.round, robot)
        between_rounds = step.rule in ("INIT", "ENV-TRANS")
        for stated in self.system.program.properties:
            at_round = stated.kind is PropertyKind.AT_ROUND
            if stated.kind is not PropertyKind.INVARIANT and not (at_round and between_rounds):
                continue
            if not self.holds(stated, step.configuration):
                return Violation(ViolationKind.PROPERTY, stated.name, step.round, step.robot)
        return None

    def holds(self, stated: core.Property, configuration: Configuration[Constant]) -> bool:
        """Whether a property holds in a configuration."""
        parts = self._parts.get(stated.name)
        if parts is None:
            parts = self._parts[stated.name] = _parts_of(self.system, stated.condition)
        if all(self._part_holds(part, stated.bound, configuration) for part in parts):
            return True
        # The property as a whole has the word, and asks its questions under its own keys.
        holds, _ = holds_in(
            self.d, self.system, configuration, stated.condition, stated.bound, self.inputs
        )
        return holds is True

    def _part_holds(self, part: _Part, bound: int, configuration: Configuration[Constant]) -> bool:
        seen = list(part.reads(configuration))
        if part.held is not None and all(
            a is b or a == b for a, b in zip(part.held, seen, strict=True)
        ):
            return True
        oracle = self.inputs.oracle(Phase.CHECK, 0)
        m = machine(self.d, self.system, oracle, bound=bound, view=configuration)
        m.trail.extend(part.trail)
        for slot, robot in part.robots.items():
            m.memory.bound[slot] = held(self.d, robot)
        holds = statement(m, part.condition) is True
        part.held = seen if holds else None
        return holds


@dataclass(slots=True)
class _Part:
    """A part of a property: what it says, of which robots, and where it looks.

    ``held`` is what it read when it was last seen to hold. Of places that are not known beforehand,
    such as ``x[y@i]``, every one that they may be is read.
    """

    condition: core.Expr
    robots: dict[int, int]  #: bound slot to robot
    trail: tuple[int, ...]
    allread: tuple[tuple[int, int | None], ...]  #: slot, entry or all
    allwrite: tuple[int, ...]
    locals: tuple[tuple[int, int], ...]  #: robot, slot
    ports: tuple[tuple[int, int], ...]
    turns: tuple[int, ...]  #: robots whose status and last event it speaks of
    held: list[object] | None = None

    def reads(self, configuration: Configuration[Constant]) -> Iterator[object]:
        store, robots = configuration.store, configuration.robots
        for slot, entry in self.allread:
            storage = store.allread[slot]
            assert isinstance(storage, Tree)
            yield storage if entry is None else storage.parts[entry]
        for slot in self.allwrite:
            yield store.allwrite[slot]
        for robot, slot in self.locals:
            yield robots[robot].locals[slot]
        for robot, slot in self.ports:
            yield robots[robot].ports[slot]
        for robot in self.turns:
            yield robots[robot].status
            yield robots[robot].ran


def _parts_of(system: System, condition: core.Expr) -> list[_Part]:
    """The parts of a property; itself alone where they are more than one can keep."""
    if _count(system, condition) > _MOST_PARTS:
        return [_part(system, condition, {}, ())]
    return list(_split(system, condition, {}, ()))


def _count(system: System, e: core.Expr) -> int:
    match e:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            return _count(system, left) + _count(system, right)
        case core.Quantified(quantifier=QuantifierKind.FORALL, domain=core.RobotRange()):
            return system.robots * _count(system, e.body)
        case _:
            return 1


def _split(
    system: System, e: core.Expr, robots: dict[int, int], trail: tuple[int, ...]
) -> Iterator[_Part]:
    """The parts of a statement: it holds if and only if all of them do. [E-SHORT] [E-QUANT]"""
    match e:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            yield from _split(system, left, robots, trail)
            yield from _split(system, right, robots, trail)
        case core.Quantified(quantifier=QuantifierKind.FORALL, domain=core.RobotRange(agent=agent)):
            for robot, kind in enumerate(system.kinds):
                if agent is None or kind == agent:
                    bound = {**robots, e.variable.slot: robot}
                    yield from _split(system, e.body, bound, (*trail, robot))
        case _:
            yield _part(system, e, robots, trail)


def _part(system: System, e: core.Expr, robots: dict[int, int], trail: tuple[int, ...]) -> _Part:
    allread: dict[tuple[int, int | None], None] = {}
    allwrite: dict[int, None] = {}
    local: dict[tuple[int, int], None] = {}
    ports: dict[tuple[int, int], None] = {}
    turns: dict[int, None] = {}
    every = range(system.robots)
    # In functions, summaries and under other quantifiers a slot may stand for something else.
    inner = {node.variable.slot for node in nodes(e) if isinstance(node, core.Quantified)}
    fixed = {slot: robot for slot, robot in robots.items() if slot not in inner}

    def named(index: core.Expr | None, fixed: dict[int, int]) -> int | None:
        """The robot that an index is, as far as one can tell beforehand."""
        match index:
            case core.Const(value=int(value)) if value in every:
                return value
            case core.Read(place=core.Place(variable=variable, steps=())) if (
                variable.home is Home.BOUND
            ):
                return fixed.get(variable.slot)
            case _:
                return None

    own = [(node, fixed) for node in nodes(e)]
    called = [(node, dict[int, int]()) for node in _called(system, e)]
    for node, known in own + called:
        match node:
            case core.Place(variable=variable, steps=steps):
                match variable.home:
                    case Home.ALLREAD:
                        first = steps[0] if steps else None
                        index = first.index if isinstance(first, core.IndexStep) else None
                        entry = named(index, known)
                        allread[variable.slot, entry] = None
                    case Home.ALLWRITE:
                        allwrite[variable.slot] = None
                    case Home.LOCAL | Home.PORT:
                        into = local if variable.home is Home.LOCAL else ports
                        which = named(node.robot, known)
                        for robot in every if which is None else (which,):
                            slot = slot_in(system.agent(robot), variable)
                            if slot is not None:
                                into[robot, slot] = None
                    case Home.BOUND:
                        pass
            case core.Ran(robot=index) | core.Stopped(robot=index):
                which = named(index, known)
                turns.update(dict.fromkeys(every if which is None else (which,)))
            case _:
                pass
    return _Part(
        e, robots, trail, tuple(allread), tuple(allwrite), tuple(local), tuple(ports), tuple(turns)
    )


def _called(system: System, part: object) -> Iterator[object]:
    """The nodes of the functions and summaries that a part of a program calls."""
    for node in nodes(part):
        match node:
            case core.Call(function=name):
                body = system.program.function(name).body
                yield from nodes(body)
                yield from _called(system, body)
            case core.ExternalCall(function=name):
                external = system.program.external(name)
                yield from nodes((external.requires, external.ensures))
            case _:
                pass
