"""Slices against the programs that they are of: what is broken there is broken here. [T-CONE]"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.verify.claims import claims_of, liveness_of
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from koord.verify.reduction.problems import identity
from koord.verify.reduction.slicing import Slices
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.generators.staged import staged
from tests.sampling import first
from tests.verify.asking import name_of, of_text

FAMILIES: dict[str, Callable[[Random], System]] = {
    "finite": partial(system, profile=FINITE),
    "symmetric": partial(system, profile=SYMMETRIC),
    "staged": staged,
}


def slice_for(text: str, name: str) -> System:
    """The slice of one claim about the program of a text."""
    of = of_text(text)
    slices = Slices(of)
    (claim,) = [claim for claim in claims_of(of) if claim.name == name]
    return slices.slice_of(slices.cone([claim]))


# --- each rule of the cone ----------------------------------------------------------------------

VARIABLES = """
using Eyes:
    sensors:
        int seen
        int other
local:
    int x = 0
    int y = 0
    int z = 0
    int unread = 0
"""


def left(text: str, name: str = "A") -> set[str]:
    """The names of what the slice of a claim keeps, of all that the texts below declare."""
    of = of_text(text)
    slices = Slices(of)
    (claim,) = [claim for claim in claims_of(of) if claim.name == name]
    kept = slices.extent(slices.cone([claim]))
    return {slices.name(part) for part in kept}


A = "\ninvariant A: forall i: x@i < 5\n"

RULES = {
    "what is assigned": ("E:\n    pre: true\n    eff: x = y\n", {"x", "y", "E"}),
    "guards": ("E:\n    pre: y > 0\n    eff: x = 1\n", {"x", "y", "E"}),
    "branches": ("E:\n    pre: true\n    eff:\n        if y > 0: x = 1\n", {"x", "y", "E"}),
    "bounds of loops": (
        "E:\n    pre: true\n    eff:\n        for k in [y]:\n            x = 1\n",
        {"x", "y", "E"},
    ),
    "breaks": (
        "E:\n    pre: true\n    eff:\n        for k = 0, 3:\n            if y > 0: break\n"
        "            x = 1\n",
        {"x", "y", "E"},
    ),
    "by way of another event": (
        "E:\n    pre: true\n    eff: x = y\nF:\n    pre: z > 0\n    eff: y = 1\n",
        {"x", "y", "z", "E", "F"},
    ),
    "nothing else": (
        "E:\n    pre: true\n    eff:\n        x = 1\n        unread = y\n"
        "F:\n    pre: true\n    eff: unread = 2\n",
        {"x", "E"},
    ),
    "what stops a robot": (
        "E:\n    pre: true\n    eff:\n        x = 1\n        if y > 0: stop\n",
        {"x", "y", "E"},
    ),
    "events that do nothing but stop": (
        "E:\n    pre: true\n    eff: x = 1\nF:\n    pre: y > 0\n    eff: stop\n",
        {"x", "E"},
    ),
    "urgency": (
        "E:\n    pre: true\n    eff: x = 1\nurgent F:\n    pre: y > 0\n    eff: unread = 1\n",
        {"x", "y", "E", "F"},
    ),
    "outputs": (
        "E:\n    pre: true\n    eff:\n        x = 1\n        stdout << y\n",
        {"x", "E"},
    ),
}


@pytest.mark.parametrize("rule", RULES)
def test_a_slice_has_what_has_an_influence_and_nothing_else(rule: str) -> None:
    events, kept = RULES[rule]
    assert left(VARIABLES + events + A) == kept


def test_locks_are_kept_with_what_decides_whether_they_are_taken() -> None:
    text = """
local:
    int x = 0
    int y = 0
allwrite:
    int n = 0
E:
    pre: true
    eff:
        x = 1
        if y > 0:
            atomic: n = 1
"""
    assert left(text + A) == {"x", "y", "E"}
    of = slice_for(text + A, "A")
    (event,) = of.program.agents[0].events
    assert len(event.effect) == 2
    assert event.lock_classes


def test_what_happens_for_ever_depends_on_all_events() -> None:
    """A fair robot may go on with F for ever, though nobody asks what F writes."""
    of = of_text(
        VARIABLES
        + "E:\n    pre: x == 0\n    eff: x = 1\n"
        + "F:\n    pre: y == 0\n    eff: unread = 1\n"
        + "eventually Done: forall i: x@i == 1\n"
    )
    slices = Slices(of)
    kept = slices.extent(slices.cone(liveness_of(of)))
    assert {slices.name(part) for part in kept} == {"x", "y", "E", "F"}


CONTRACT = """
using Eyes:
    sensors:
        int seen
        int other
        int third
    contract K:
        requires: other > 0
        ensures:
            seen' < third'
            other' > seen
local:
    int x = 0
E:
    pre: true
    eff: x = Eyes.{sensor}
"""


def test_contracts_belong_to_what_they_restrict() -> None:
    assert left(CONTRACT.format(sensor="third") + A) == {"x", "third", "seen", "other", "E"}
    assert left(CONTRACT.format(sensor="other") + A) == {"x", "other", "seen", "third", "E"}


def test_a_promise_that_restricts_nothing_of_a_slice_is_none_of_it() -> None:
    text = CONTRACT.replace("seen' < third'", "third' > 0")
    assert left(text.format(sensor="third") + A) == {"x", "third", "other", "seen", "E"}
    assert left(text.format(sensor="other") + A) == {"x", "other", "seen", "E"}


def test_assumptions_belong_to_all_that_they_read() -> None:
    text = "local:\n    int x\n    int y\n    int z\n"
    events = "E:\n    pre: true\n    eff: x = x\n"
    events += "assume: forall i: z@i > 0\nassume: forall i: x@i < y@i\n"
    assert left(text + events + A) == {"x", "y", "E"}


def test_summaries_that_name_each_other_stay_together() -> None:
    text = """
def fun f(int a) -> int: extern
def fun g(int a) -> int: extern
    ensures: result < f(a)
def fun h(int a) -> int: extern
local:
    int x = 0
    int y = 0
E:
    pre: true
    eff: x = f(x)
F:
    pre: true
    eff: y = h(g(y))
"""
    kept = slice_for(text + A, "A").program.externals
    assert [external.name for external in kept] == ["f", "g"]


def test_what_may_fault_belongs_to_no_fault() -> None:
    text = "local:\n    int x = 0\n    int y = 1\n    int z = 0\n"
    events = "E:\n    pre: z > 0\n    eff:\n        if z > 1: x = 1 / y\n"
    events += "F:\n    pre: true\n    eff: x = z\n"
    assert left(text + events + A, "no fault") == {"x", "y", "z", "E", "F"}
    assert left(text + events.replace("1 / y", "y") + A, "no fault") == set()


def test_maps_may_fault_where_they_are_read_and_not_where_they_get_entries() -> None:
    text = "local:\n    int x = 0\n    Map<int, int> m = {}\n"
    events = "E:\n    pre: true\n    eff: m[x] = 1\n"
    assert left(text + events + A, "no fault") == set()
    assert left(text + events.replace("m[x] = 1", "x = m[1]") + A, "no fault") == {"x", "m", "E"}


def test_a_loop_that_only_leaves_itself_may_fault() -> None:
    text = "local:\n    int x = 0\n    int y = 1\n"
    events = "E:\n    pre: true\n    eff:\n        for k = 0, 3:\n            if 1 / y > 0: break\n"
    (event,) = slice_for(text + events + A, "no fault").program.agents[0].events
    assert event.effect


# --- the law --------------------------------------------------------------------------------------


def firsts(of: System) -> tuple[dict[str, int], bool] | None:
    """By claim the first round in which a search sees it broken, and whether that is all."""
    limits = Limits(states=400, rounds=8)
    try:
        found = survey(of, of.program.properties, limits, subjects=frozenset(GoalKind))
    except NotFiniteError:
        return None
    if isinstance(found.end, NotFinite):
        return None
    broken = {name_of(v.claim): v.rounds for v in found.violated}
    return broken, isinstance(found.end, Exhausted)


def compare(of: System, seed: int) -> Counter[str]:
    """What a program breaks is broken by the slice, as soon at least.

    The other way round nothing may stand in the way: no fault, no assumption and no contract.
    """
    count: Counter[str] = Counter()
    whole = firsts(of)
    if whole is None:
        return count
    broken, is_all = whole
    slices = Slices(of)
    free = "no fault" not in broken and not of.program.assumptions and is_all
    free = free and not any(m.contracts for agent in of.program.agents for m in agent.modules)
    for claim in claims_of(of):
        part = slices.slice_of(slices.cone([claim]))
        if part is of:
            count["whole"] += 1
            continue
        assert identity(claim) in {identity(c) for c in claims_of(part)}, seed
        found = firsts(part)
        if found is None:
            continue
        expected, seen = broken.get(claim.name), found[0].get(claim.name)
        if expected is not None:
            assert seen is not None, (seed, claim.name)
            assert seen <= expected, (seed, claim.name)
        if free:
            assert seen == expected, (seed, claim.name)
            count["exact"] += 1
        count["broken" if seen is not None else "kept"] += 1
    return count


@pytest.mark.parametrize("family", first(1, FAMILIES))
def test_a_slice_breaks_what_its_program_breaks(family: str) -> None:
    seeds = (1084, *range(16))
    count = sum((compare(FAMILIES[family](Random(s)), s) for s in seeds), Counter[str]())
    assert count["broken"] > 8, count
    assert count["exact"] > 8, count


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("block", range(10))
def test_a_slice_breaks_what_its_program_breaks_of_many(family: str, block: int) -> None:
    seeds = range(1_000 + block * 100, 1_100 + block * 100)
    count = sum((compare(FAMILIES[family](Random(s)), s) for s in seeds), Counter[str]())
    assert count["broken"] > 50, count
