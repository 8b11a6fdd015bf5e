"""Reachability goals: events that should run, and suppositions that should come true.

A goal is stated as the claim that it is *never* reached, so that engines can decide it: a violation
is a run that reaches it, and a proof means that none does. The claims are about a program that has
the same runs, with the additions that state them: copies of functions (``suppositions.py``), and
contracts of modules that have no ports and models that do nothing. Such a contract is a claim of
the environment's turns [PROP-CONTRACT]: that what another contract supposes never holds as they
begin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from functools import reduce
from itertools import chain, count
from typing import Any, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.premises import Premise, promises_of
from koord.syntax.analysis.suppositions import Denial, SuppositionReader
from koord.syntax.core import BinaryOp, Home, PropertyKind, QuantifierKind, UnaryOp
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes, rebuilt
from koord.verify.claims import Claim, ClaimKind, reads_ports


class Aim(Enum):
    """The kinds of reachability goals."""

    EVENT = "event"  #: that it runs, in a round that ends
    SUPPOSITION = "supposition"  #: that what a property supposes is true of some configuration
    CONTRACT = "contract"  #: that what a contract supposes is, as the environment's turn begins


class ReachabilityGoal(Struct, frozen=True):
    """A reachability goal. ``subject`` is the event, or the property or contract that supposes.

    Where it is ``observed``, it may come true between the ends of rounds, too. If it never does,
    ``promises`` that rest on it may be the reason. ``still`` says of configurations what ``never``
    says of turns: where it holds it helps to prove that.
    """

    aim: Aim
    subject: str
    never: Claim
    span: Span
    observed: bool = False
    promises: tuple[Premise, ...] = ()
    still: Claim | None = None


#: Aim, subject, the condition that denies it, how many bound slots that needs, its place, and
#: whether it may come true between the ends of rounds.
_Stated: TypeAlias = "tuple[Aim, str, core.Expr, int, Span, bool]"


class ReachabilityGoals(Struct, frozen=True):
    """All reachability goals, and the system in which they are stated."""

    system: System
    all: tuple[ReachabilityGoal, ...]


def reachability_goals_of(system: System) -> ReachabilityGoals:
    """The reachability goals of a system."""
    reading = SuppositionReader(system.program)
    goals = [
        ReachabilityGoal(
            aim, subject, _never(system.program, f"never {n}", condition, bound), span, observed
        )
        for n, (aim, subject, condition, bound, span, observed) in enumerate(
            [*_events(system), *_suppositions(reading)]
        )
    ]
    modules: dict[int, list[core.Contract]] = {}
    for key, denials in _of_contracts(system, reading).items():
        name = f"never {len(goals)}"
        never = Claim(f"contract {name}", ClaimKind.CONTRACT, None, name)
        subject = f"contract {key.contract}"
        still = _still(system.program, name, denials)
        goal = ReachabilityGoal(
            Aim.CONTRACT, subject, never, key.span, promises=key.promises, still=still
        )
        goals.append(goal)
        for kind, denial in denials.items():
            modules.setdefault(kind, []).append(replace(denial, name=name))
    return ReachabilityGoals(_with(system, goals, reading.copies, modules), tuple(goals))


def supposes(program: core.Program, condition: core.Expr) -> bool:
    """Return whether a statement is an implication whose premise should come true."""
    return any(SuppositionReader(program).denials(condition, disjunctions=False))


def _with(
    system: System,
    goals: Sequence[ReachabilityGoal],
    copies: Sequence[core.Function],
    modules: Mapping[int, Sequence[core.Contract]],
) -> System:
    """The system with the additions that state the goals. It has the same runs."""
    program = system.program
    agents = tuple(
        replace(agent, modules=(*agent.modules, idle(modules[kind]))) if kind in modules else agent
        for kind, agent in enumerate(program.agents)
    )
    # Which robots may change places hangs on what is asked about them, so that is in it, too.
    claims = [claim for goal in goals for claim in (goal.never, goal.still) if claim is not None]
    stated = [claim.stated for claim in claims if claim.stated is not None]
    program = replace(
        program,
        agents=agents,
        functions=(*program.functions, *copies),
        properties=(*program.properties, *stated),
    )
    return replace(system, program=program)


def idle(contracts: Sequence[core.Contract]) -> core.Module:
    """A module whose model does nothing."""
    return core.Module("wishes", (), (), 0, tuple(contracts))


def _never(program: core.Program, name: str, condition: core.Expr, bound: int) -> Claim:
    stated = core.Property(name, PropertyKind.AT_ROUND, condition, bound)
    reads = reads_ports(program, condition)
    return Claim(name, ClaimKind.PROPERTY, stated, reads_ports=reads)


def _events(system: System) -> Iterator[_Stated]:
    agents = system.program.agents
    for kind in sorted(set(system.kinds)):
        for position, event in enumerate(agents[kind].events):
            robot = core.Variable(Home.BOUND, 0, "i", INT)
            ran = core.Ran(((kind, position),), core.Read(core.Place(robot)))
            denied = core.Unary(UnaryOp.NOT, ran, BOOL)
            domain = core.RobotRange(kind)
            body = core.Quantified(QuantifierKind.FORALL, robot, domain, denied)
            yield Aim.EVENT, event.name, body, 1, event.span, False


def _suppositions(reading: SuppositionReader) -> Iterator[_Stated]:
    for stated in reading.program.properties:
        for denial, span in _denials(reading, stated):
            each = stated.each
            if each is not None:
                robots, every = core.RobotRange(each.agent), QuantifierKind.FORALL
                denial = core.Quantified(every, each.variable, robots, denial)
            observed = stated.kind is PropertyKind.INVARIANT
            yield Aim.SUPPOSITION, stated.name, denial, stated.bound, span, observed


def _denials(reading: SuppositionReader, stated: core.Property) -> Iterator[Denial]:
    if stated.trigger is not None:
        yield core.Unary(UnaryOp.NOT, stated.trigger, BOOL), stated.trigger.span
        return
    # What is the case sooner or later may as well be one thing or not another.
    is_goal = stated.kind is PropertyKind.EVENTUALLY
    yield from reading.denials(stated.condition, disjunctions=not is_goal)


# --- contracts ------------------------------------------------------------------------------------


class _Supposed(Struct, frozen=True):
    """A supposition of a contract, wherever its module is used.

    ``place`` counts what the contract supposes; 0 is what it requires.
    """

    module: str
    contract: str
    place: int
    span: Span
    promises: tuple[Premise, ...]


def _of_contracts(
    system: System, reading: SuppositionReader
) -> dict[_Supposed, dict[int, core.Contract]]:
    """The suppositions of contracts, each with contracts that deny it, by kind of robot."""
    found: dict[_Supposed, dict[int, core.Contract]] = {}
    for kind in sorted(set(system.kinds)):
        for module in system.program.agents[kind].modules:
            for contract in module.contracts:
                for supposed, denial in _supposed(module, contract, reading):
                    found.setdefault(supposed, {})[kind] = denial
    return found


def _supposed(
    module: core.Module, contract: core.Contract, reading: SuppositionReader
) -> Iterator[tuple[_Supposed, core.Contract]]:
    promises, names = promises_of(module, contract), (module.name, contract.name)
    if not all(isinstance(e, core.Const) for e in contract.requires):
        required = _Supposed(*names, 0, contract.requires[0].span, promises)
        yield required, replace(contract, ensures=(core.Const(False, BOOL),))
    places = count(1)
    for number, ensured in enumerate(contract.ensures):
        for denial, span in reading.denials(ensured, _is_before):
            supposed = _Supposed(*names, next(places), span, promises[number : number + 1])
            yield supposed, replace(contract, ensures=(denial,))


def _is_before(e: core.Expr) -> bool:
    """Return whether a part of a contract reads only ports before the turn."""
    return not any(isinstance(node, core.Place) and node.primed for node in nodes(e))


def _still(program: core.Program, name: str, denials: Mapping[int, core.Contract]) -> Claim | None:
    """A denial as a property of configurations, if it can be stated so."""
    parts = (nodes((denial.requires, denial.ensures)) for denial in denials.values())
    if any(isinstance(node, core.Call) for node in chain.from_iterable(parts)):
        return None  # functions may read the robot that runs
    said = [_said_of_all(kind, denial) for kind, denial in denials.items()]
    condition = reduce(lambda a, b: core.Binary(BinaryOp.AND, a, b, BOOL), said)
    bound = 1 + max(denial.bound for denial in denials.values())
    return _never(program, f"{name} at all", condition, bound)


def _said_of_all(kind: int, denial: core.Contract) -> core.Expr:
    robot = core.Variable(Home.BOUND, denial.bound, "robot", INT)
    read = core.Read(core.Place(robot))

    def part(node: Any) -> Any:
        if isinstance(node, core.Pid):
            return read
        if isinstance(node, core.Place) and node.variable.home is Home.PORT:
            node = replace(node, robot=read)
        return rebuilt(node, part)

    (said,) = denial.ensures
    for required in reversed(denial.requires):
        said = core.Binary(BinaryOp.IMPLIES, required, said, BOOL)
    return core.Quantified(QuantifierKind.FORALL, robot, core.RobotRange(kind), part(said))
