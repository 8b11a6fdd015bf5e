"""The generators: what they make is well formed, has everything in it, and can be run."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from functools import cache
from random import Random
from typing import get_args

import pytest
from hypothesis import given
from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.generating.palette import GENERAL, Profile
from koord.refinement.generating.programs import system
from koord.semantics.configurations import Turn
from koord.semantics.domain import EXACT
from koord.semantics.recordings import execute
from koord.syntax import core, types
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT
from tests.generators.configurations import configuration
from tests.generators.profiles import FINITE
from tests.generators.runs import recording
from tests.generators.strategies import systems
from tests.generators.wellformed import complaints
from tests.sampling import examples, first

SEEDS = range(300)

PROFILES = pytest.mark.parametrize("profile", [GENERAL, FINITE], ids=["general", "finite"])

#: What no generated program has: made by the verifier, or for summaries that cannot be tried.
ABSENT = {core.AllValues, types.OpaqueType, types.StreamType}


@cache
def generated(profile: Profile) -> tuple[System, ...]:
    return tuple(system(Random(seed), profile) for seed in SEEDS)


def parts(node: object) -> Iterator[object]:
    """Everything that a program is made of: nodes, types, members of enumerations."""
    yield node
    if isinstance(node, tuple | frozenset):
        for part in node:
            yield from parts(part)
    elif isinstance(node, Struct):
        for name in node.__struct_fields__:
            yield from parts(getattr(node, name))


@PROFILES
def test_programs_are_well_formed(profile: Profile) -> None:
    for made in generated(profile):
        assert complaints(made.program) == []


@PROFILES
def test_a_seed_determines_its_program(profile: Profile) -> None:
    assert generated(profile)[:5] == tuple(system(Random(seed), profile) for seed in range(5))


def test_every_construct_is_generated() -> None:
    seen = [part for made in generated(GENERAL) for part in parts(made.program)]
    classes = {type(part) for part in seen}
    members = {part for part in seen if isinstance(part, Enum)}
    unions = (core.Expr, core.Stmt, core.Step, core.QuantifierDomain, types.Type)
    assert {c for union in unions for c in get_args(union)} - classes == ABSENT
    enums: tuple[type[Enum], ...] = (
        core.UnaryOp,
        core.BinaryOp,
        core.ListOp,
        core.Home,
        core.QuantifierKind,
        core.Start,
        core.Direction,
        core.ExternalKind,
        core.PropertyKind,
    )
    assert {member for enum in enums for member in enum} <= members


def test_every_kind_of_program_is_generated() -> None:
    programs = [made.program for made in generated(GENERAL)]
    agents = [agent for program in programs for agent in program.agents]
    events = [event for agent in agents for event in agent.events]
    modules = [module for agent in agents for module in agent.modules]
    assert any(len(program.agents) > 1 for program in programs)
    assert any(event.urgent and event.lock_classes for event in events)
    assert any(len(event.lock_classes) > 1 for event in events)
    assert any(module.environment and module.contracts for module in modules)
    assert any(module.environment is None and module.contracts for module in modules)
    assert any(agent.init for agent in agents)
    assert any(external.ensures for program in programs for external in program.externals)


@PROFILES
def test_configurations_are_at_the_start_of_a_round(profile: Profile) -> None:
    for seed, made in enumerate(generated(profile)[:50]):
        start = configuration(Random(seed), made)
        assert start.turn is Turn.PROG
        assert len(start.robots) == made.robots
        assert all(robot.copy == start.store for robot in start.robots)


@PROFILES
@pytest.mark.parametrize("count", first(1, [60, len(SEEDS)]))
def test_random_recordings_replay(count: int, profile: Profile) -> None:
    lengths = []
    for seed, made in enumerate(generated(profile)[:count]):
        played = recording(Random(seed), made, rounds=3)
        if played is None:
            continue
        steps = list(execute(EXACT, made, played))
        lengths.append(len(played.rounds))
        assert steps[-1].round in (len(played.rounds) - 1, -1)
    # Many runs fault early, and that is as it should be; but not most of them.
    assert len(lengths) > 0.83 * count
    assert sum(length == 3 for length in lengths) > count * (1 if profile is GENERAL else 2) / 3


@examples(20)
@given(systems(FINITE))
def test_the_strategy_gives_systems(made: System) -> None:
    assert complaints(made.program) == []
    assert made.robots in range(FINITE.robots[0], FINITE.robots[1] + 1)


# --- the checker, on programs that are wrong ------------------------------------------------------


def altered(effect: core.Block = (), guard: core.Expr | None = None) -> core.Program:
    made = generated(GENERAL)[0].program
    agent = made.agents[0]
    truth = core.Const(True, BOOL)
    event = core.Event("E", False, guard or truth, effect, 1, frozenset())
    return replace(made, agents=(replace(agent, events=(event,)), *made.agents[1:]))


BOUND = core.Variable(core.Home.BOUND, 0, "b", INT)


@pytest.mark.parametrize(
    ("effect", "guard", "blamed"),
    [
        ((), core.Const(1, INT), "where bool is expected"),
        ((core.Assign(core.Place(BOUND), core.Const(True, BOOL)),), None, "where int"),
        ((core.Break(),), None, "break outside"),
        ((core.Return(None),), None, "return outside"),
        ((core.Atomic(0, ()),), None, "enters {0}"),
        ((core.Append(core.Place(BOUND), core.Const(1, INT)),), None, "is no list"),
        ((), core.Stopped(core.Const(True, BOOL)), "where int is expected"),
    ],
)
def test_mistakes_are_found(effect: core.Block, guard: core.Expr | None, blamed: str) -> None:
    assert any(blamed in complaint for complaint in complaints(altered(effect, guard)))
