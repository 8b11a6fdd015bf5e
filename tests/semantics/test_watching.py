"""Watching a run part by part sees what looking at everything sees."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.sampling.monitors import Monitor
from koord.sampling.policies import AtRandom
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Recording, execute
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import ArrayType, Robots
from koord.traces.trace import Numbers
from tests.generators.runs import recording
from tests.generators.strategies import systems
from tests.loading import example_program
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.building import (
    INT,
    PID,
    TRUE,
    Build,
    E,
    I,
    J,
    N,
    back,
    bound,
    e,
    exists,
    forall,
    ran,
    stopped,
)
from tests.semantics.driving import played

EXAMPLES = Path(__file__).parents[2] / "specs/examples"


def check(system: System, made: Recording) -> int:
    """Compare on every configuration of a run; how often a property did not hold."""
    d = Numbers.EXACT.domain
    inputs = SampledInputs(Sampler(system, Numbers.EXACT, Random(0)))
    watch, broken = Monitor(d, system, inputs), 0
    for step in execute(d, system, made):
        c = step.configuration
        if c.fault is not None:
            break
        for stated in system.program.properties:
            whole, _ = holds_in(d, system, c, stated.condition, stated.bound, inputs)
            assert watch.holds(stated, c) == (whole is True), (stated.name, step.round, step.robot)
            broken += whole is not True
    return broken


@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
@given(seed=st.integers(0, 10**6))
@examples(5)
def test_of_programs_at_hand(program: core.Program, seed: int) -> None:
    """[PROP-INVARIANT] [PROP-READ]"""
    rng = Random(seed)
    _, trace = played(program, AtRandom(rng), rounds=5, rng=rng)
    check(trace.system, trace.recording)


@given(system=systems(), seed=st.integers(0, 10**6))
@examples(40)
def test_of_generated_programs(system: System, seed: int) -> None:
    """[PROP-INVARIANT] [PROP-READ] [E-QUANT]"""
    made = recording(Random(seed), system, 2)
    if made is not None:
        check(system, made)


@pytest.mark.parametrize("name", ["lineform", "fischer", "shortest_path", "leader_elect", "hvac"])
def test_of_examples(name: str) -> None:
    """[PROP-INVARIANT]"""
    program = example_program(name)
    rng = Random(6)
    _, trace = played(program, AtRandom(rng), rounds=8, rng=rng)
    check(trace.system, trace.recording)


def test_places_that_are_known_in_part_only() -> None:
    """[PROP-READ] [E-CALL] [E-QUANT]: through functions, variables as robots, inner quantifiers."""
    b = Build()
    whole = ArrayType(INT, Robots.ALL)
    xs, k = bound("xs", 0, whole), bound("k", 1, INT)
    b.function("entry", [xs, k], INT, back(xs[k]), bound=2)
    x = b.allread("x", INT, PID)
    friend, n = b.local("friend", INT, (PID + 1) % N), b.local("n", INT, 0)
    total = b.allwrite("total", INT, 0)
    b.event("Grow", n < 3, n.set(n + 1), x[PID].set(x[PID] + 1), total.set(total + PID))
    b.event("Turn", TRUE, friend.set((friend + 1) % N))
    b.event("End", n.eq(3), core.Stop())

    def call(index: E) -> E:
        return b.call("entry", x, index)

    for number, condition in enumerate(
        [
            forall(I, x[I] < I + 3),
            forall(I, x[friend.at(I)] < 4),
            forall(I, n.at(friend.at(I)) < 3),
            forall(I, call(I) < 4),
            forall(I, call(friend.at(I)).ne(4)),
            forall(I, forall(J, (I < J) >> (x[I] <= x[J]))),
            forall(I, exists(J, x[J] > x[I]) | (n.at(I) > 0)),
            forall(I, n.at(0) <= n.at(I) + 1) & (total < 5),
            forall(I, ~ran(1, I) | friend.at(I).ne(I)),
            forall(I, stopped(I) >> n.at(I).eq(3)) & ~stopped(1),
            exists(I, n.at(I).eq(0)),
            e(0, INT) < N,
        ]
    ):
        b.invariant(f"P{number}", condition)
    program = b.program()
    broken = 0
    for seed in range(6):
        rng = Random(seed)
        bare = core_without_properties(program)
        _, trace = played(bare, AtRandom(rng), rounds=8, rng=rng)
        broken += check(dealt(program, 3), trace.recording)
    assert broken > 50


def core_without_properties(program: core.Program) -> core.Program:
    """The program with nothing to break, so that runs go on."""
    return replace(program, properties=())
