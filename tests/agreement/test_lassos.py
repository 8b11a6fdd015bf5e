"""The search for fair cycles against lassos found by walking; what it finds is one.

[LIVE-RUN] [FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME] [T-FAIR-CYCLE] [T-FULL-STATES]
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from msgspec.structs import replace

from koord.refinement.generating.drafts import Draft
from koord.refinement.generating.palette import palette
from koord.refinement.generating.programs import system
from koord.refinement.generating.properties import property_
from koord.semantics.domain import EXACT
from koord.semantics.recordings import execute
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT
from koord.traces.lassos import flaw_of
from koord.verify.engines.explicit.fair_answers import FairCycleReport
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted
from tests.generators.profiles import FINITE
from tests.sampling import blocks
from tests.semantics.plain_lassos import PlainLassos
from tests.semantics.plain_search import TooMuchError

#: Steps that the plain search may take on one system.
STEPS = 6_000

#: As ``FINITE``, of programs that go on: little faults, and locks are asked for.
LIVELY = replace(FINITE, faulty=0.0, unset=0.0, statements=(1, 2), urgent=0.1)


def with_liveness(of: System, random: Random) -> System:
    """The system with random liveness properties, and at times an expectation."""
    draft = Draft(random, LIVELY, palette(random, finite=True))
    program = of.program
    shared = [entry.variable for entry in (*program.allread, *program.allwrite)]

    def made(name: str, kind: PropertyKind) -> core.Property:
        return property_(draft, name, kind, shared, program.agents)

    stated = [made("sooner", PropertyKind.EVENTUALLY), made("leads", PropertyKind.LEADS_TO)]
    stated.append(ran(made("runs", PropertyKind.LEADS_TO), of, random))
    promised: list[core.Property] = []
    if random.random() < 0.4:
        promised.append(made("expected", PropertyKind.LEADS_TO))
    if random.random() < 0.3:
        promised.append(ran(made("each", PropertyKind.LEADS_TO), of, random))
    once = ran(made("once", PropertyKind.LEADS_TO), of, random, always=True)
    stated.append(replace(once, kind=PropertyKind.EVENTUALLY, trigger=None))
    return replace(
        of,
        program=replace(program, properties=tuple(stated), expectations=tuple(promised)),
    )


def ran(
    stated: core.Property, of: System, random: Random, *, always: bool = False
) -> core.Property:
    """The property with the trigger, or the goal, that each robot by itself ran an event.

    ``always`` makes it the goal.
    """
    robot = core.Variable(Home.BOUND, stated.bound, "pid", INT)
    kind = random.randrange(len(of.program.agents))
    position = random.randrange(len(of.program.agents[kind].events))
    ran: core.Expr = core.Ran(((kind, position),), core.Read(core.Place(robot)))
    each = core.Each(robot, kind if len(of.program.agents) > 1 else None)
    if not always and random.random() < 0.5:
        return replace(stated, trigger=ran, each=each, bound=stated.bound + 1)
    truth = core.Const(True, BOOL)
    return replace(stated, trigger=truth, condition=ran, each=each, bound=stated.bound + 1)


def searched(of: System, states: int = 300) -> FairCycleReport | None:
    found = lively(of, of.program.properties, Limits(states=states))
    return found if isinstance(found.end, Exhausted) else None


def assert_lassos(of: System, found: FairCycleReport, seed: object) -> None:
    """What was found replays, closes, is fair, and breaks the property. [LASSO]"""
    for name, recording in found.violated.items():
        stated = next(p for p in of.program.properties if p.name == name)
        steps = execute(EXACT, of, recording)
        ends = [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]
        assert flaw_of(of, recording, ends, stated) is None, (seed, name)


def compare(seed: int) -> str:
    random = Random(seed)
    of = with_liveness(system(random, LIVELY), random)
    found = searched(of)
    if found is None:
        return "too large, or not finite"
    assert_lassos(of, found, seed)
    try:
        plain = PlainLassos(of, of.program.properties, limit=STEPS)
        broken = {p.name for p in of.program.properties if plain.is_broken(p)}
        is_empty = not plain.has_fair_run()
    except TooMuchError:
        return "too large"
    assert set(found.violated) == broken, seed
    assert set(found.needs) == {p.name for p in of.program.properties} - broken, seed
    assert found.is_empty is is_empty, seed
    if is_empty:
        return "no fair run"
    return "violated" if broken else "holds"


@pytest.mark.parametrize("seeds", blocks(6, of=20, count=4))
def test_as_the_plain_lassos(seeds: range) -> None:
    count = Counter(compare(seed) for seed in seeds)
    assert count["violated"] >= len(seeds) // 5, count


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_as_the_plain_lassos_on_many(block: int) -> None:
    seeds = range(10_000 + block * 300, 10_300 + block * 300)
    count = Counter(compare(seed) for seed in seeds)
    assert count["violated"] + count["holds"] > 140, count
