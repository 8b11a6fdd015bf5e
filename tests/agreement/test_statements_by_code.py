"""Statements about configurations by code against the rules. [PROP-READ] [PROP-FAULT] [INIT]"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.sampling.compiled.configurations import misses_code, statement_code
from koord.sampling.initial_state_search import misses
from koord.sampling.reached import reached
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.domain import EXACT
from koord.semantics.oracle import Phase
from koord.semantics.rounds import initialised
from koord.semantics.statements import machine
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, INT
from koord.traces.trace import Numbers
from koord.verify.engines.every_n.bound import READ_I, READ_K
from koord.verify.engines.every_n.conditions import conditions_of, value_in
from koord.verify.engines.every_n.language import Language
from tests.loading import example_program, program_of

GIVEN = [read.place.variable for read in (READ_I, READ_K)]


@pytest.mark.parametrize("name", ["bakery", "majority_election", "naive_consensus"])
def test_conditions_are_as_the_rules_have_them(name: str) -> None:
    """What guards and claims ask of many robots, in samples: never in doubt."""
    system = dealt(example_program(f"protocols/{name}"), 3)
    size = Language.of_program(system.program).size
    found = conditions_of(system.program, size)
    codes = [statement_code(EXACT, system, GIVEN, x.said) for x in found]
    said = Counter[object]()
    for here in reached(system, 60):
        for x, code in zip(found, codes, strict=True):
            for robot in range(3) if x.of else (None,):
                who = None if robot is None else core.Const(robot, INT)
                asked = x.at(who, core.Const(0, INT))
                value = code.ask(here, robot, 0)
                assert value == value_in(system, here, asked, x.bound)
                said[value] += 1
    assert said[True]
    assert said[False]


def starts(system: System, tries: int) -> list[tuple[int, ...]]:
    """What is missed of each assumption of some starts, which the rules and code agree on."""
    codes = [misses_code(EXACT, system, a.condition) for a in system.program.assumptions]
    found = []
    for seed in range(tries):
        inputs = SampledInputs(Sampler(system, Numbers.EXACT, Random(seed)))
        here = initialised(EXACT, system, inputs, tuple(range(system.robots))).configuration
        missed = []
        for assumption, code in zip(system.program.assumptions, codes, strict=True):
            oracle = inputs.oracle(Phase.CHECK, 0)
            m = machine(EXACT, system, oracle, bound=assumption.bound, view=here)
            by_code, by_rules = code.ask(here), misses(m, assumption.condition)
            assert by_code is None or by_code == by_rules
            missed.append(-1 if by_code is None else by_code)
        found.append(tuple(missed))
    return found


def test_misses_are_counted_as_by_the_rules() -> None:
    ring = starts(dealt(example_program("protocols/ring_election"), 3), 30)
    assert {0, 2, 3} < {number for missed in ring for number in missed}
    for name in ("lineform", "protocols/dijkstra_ring", "protocols/firewall", "delivery"):
        starts(dealt(example_program(name), 3), 10)


def test_a_condition_that_does_not_hold_misses_nothing() -> None:
    system = dealt(
        program_of(
            """
            allread:
                int[numAgents] x
            assume: forall i: x[i] > 0 implies x[i] == 5 and x[i] != 5
            Go:
                pre: x[pid] > 0
                eff:
                    x[pid] = 0
            """
        ),
        2,
    )
    assert {missed for (missed,) in starts(system, 30)} == {0, 1, 2}


def test_what_faults_is_in_doubt() -> None:
    """Beyond an array, and what is not set: the rules say what holds then."""
    system = dealt(
        program_of(
            """
            allread:
                int[numAgents] x = 0
            local:
                int y
            Go:
                eff:
                    y = 1
            """
        ),
        2,
    )
    x, y = system.program.allread[0].variable, system.program.agents[0].locals[0].variable
    here, *_ = reached(system, 1)
    at = core.IndexStep(READ_I, INT)
    shared = core.Binary(core.BinaryOp.EQ, core.Read(core.Place(x, (at,))), READ_K, BOOL)
    code = statement_code(EXACT, system, GIVEN, shared)
    assert (code.ask(here, 1, 0), code.ask(here, 1, 3), code.ask(here, 2, 0)) == (True, False, None)
    own = core.Binary(core.BinaryOp.EQ, core.Read(core.Place(y, robot=READ_I)), READ_K, BOOL)
    code = statement_code(EXACT, system, GIVEN, own)
    assert code.ask(here, 0, 0) is None
    assert code.function is not None
    assert statement_code(EXACT, system, GIVEN, core.Pid(INT)).function is None
