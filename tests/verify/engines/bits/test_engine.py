"""What the engine on bits says of programs: proofs, violations, and what it cannot follow."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

import pytest

from koord.syntax.system import System, dealt
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import engine
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery
from koord.verify.engines.bits.invariants import Lemmas, lemmas
from koord.verify.engines.bits.unrolling import holds_always
from koord.verify.ledger import Ledger
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.loading import program_of
from tests.sampling import first
from tests.verify.engines.bits.asking import on_bits


def of_text(text: str, robots: int = 2, **params: int) -> System:
    return dealt(program_of(text, **params), robots, Fraction(1, 10))


def of_file(name: str, robots: int, **params: int) -> System:
    with open(f"specs/examples/{name}", encoding="utf-8") as file:
        return of_text(file.read(), robots, **params)


@lru_cache(maxsize=2)
def settled(text: str, robots: int, rounds: int) -> Ledger:
    """What bits say of all claims of a text."""
    return on_bits(of_text(text, robots), rounds)


def said(text: str, name: str, *, robots: int = 2, rounds: int = 3) -> Verdict:
    """The verdict on one claim."""
    ledger = settled(text, robots, rounds)
    (claim,) = [claim for claim in ledger.claims if claim.name == name]
    return ledger.verdict(claim)


def named(report: Report, name: str) -> Verdict:
    (found,) = [v for v in report.verdicts if v.claim.name == name]
    return found


COUNTER = """
local:
    int x = 0

Count:
    pre: x < 100
    eff: x = x + 7

invariant Soon: forall i: x@i < 70
invariant Never: forall i: x@i <= 106
invariant No: forall i: x@i != 90
"""


def test_numbers_are_followed_as_far_as_need_be() -> None:
    soon = said(COUNTER, "Soon", robots=1)
    assert soon.outcome is Outcome.VIOLATED
    assert soon.counterexample is not None
    assert soon.counterexample.round == 10
    for name in ("Never", "No"):
        verdict = said(COUNTER, name, robots=1)
        assert (verdict.outcome, verdict.rounds) == (Outcome.HOLDS, None)


ENDLESS = """
local:
    int x = 0
    bool odd = false

Count:
    pre: true
    eff:
        x = x + 2
        odd = not odd

invariant Even: forall i: x@i % 2 == 0
invariant Free: forall i: odd@i or not odd@i
"""


WIDE = """
using Dial:
    sensors:
        int level = 1267650600228229401496703205376
    environment:
        level = 1267650600228229401496703205377

local:
    int x = 0
    int y = 0
    int z = 1267650600228229401496703205376
    int stage = 0
    bool p = false

One:
    pre: not p
    eff:
        p = true
        x = 1152921504606846976

Other:
    pre: stage > 5
    eff: y = 1152921504606846976

On:
    pre: stage < 2
    eff: stage = stage + 1

Grow:
    pre: stage == 2
    eff: z = z + min(stage, 1152921504606846976)

invariant Same: forall i: x@i == y@i
invariant Large: forall i: stage@i == 1 implies z@i < 5
invariant Least: forall i: z@i >= 1267650600228229401496703205376
invariant Late: forall i: stage@i < 2
"""


@pytest.mark.parametrize(("name", "round_"), [("Same", 1), ("Large", 1), ("Late", 2)])
def test_numbers_that_are_too_wide_to_be_followed_are_not_taken_for_others(
    name: str, round_: int
) -> None:
    """In round 1 x becomes 2^60, and the stage goes on; z, 2^100 at first, comes later."""
    verdict = said(WIDE, name, robots=1)
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.round == round_
    assert said(WIDE, "Least", robots=1).outcome is not Outcome.VIOLATED


@pytest.mark.parametrize("power", first(3, [47, 48, 200, 46, 60, 64]))
def test_numbers_grow_as_far_as_they_like(power: int) -> None:
    """What doubles for ever is followed, or open: never an error, and never a wrong verdict."""
    for other in (0, 1):
        text = DOUBLING.format(number=3 * 2**power + other)
        assert said(text, "Never", robots=1, rounds=4).outcome is not Outcome.VIOLATED
        assert said(text, "Less", robots=1, rounds=4).outcome is not Outcome.HOLDS


DOUBLING = """
local:
    int x = 3

Double:
    pre: true
    eff: x = x * 2

invariant Never: forall i: 4 * x@i != {number} or {number} % 2 == 0
invariant Less: forall i: x@i <= {number}
"""


def test_numbers_without_end_are_open_where_it_matters() -> None:
    assert said(ENDLESS, "Free").outcome is Outcome.HOLDS
    even = said(ENDLESS, "Even", rounds=4)
    assert even.outcome is not Outcome.VIOLATED
    assert even.rounds is not None or even.outcome is Outcome.UNKNOWN


def test_numbers_that_grow_finer_without_end_are_open_and_nothing_else_is() -> None:
    halved = (
        "local:\n    float x = 1.0\n    bool small = false\n\n"
        "Halve:\n    eff:\n        x = x / 2.0\n"
        "        small = not small\n\ninvariant Free: forall i: small@i or not small@i\n"
        "invariant Large: forall i: x@i >= 0.5\n"
    )
    assert said(halved, "Free").outcome is Outcome.HOLDS
    assert said(halved, "Large").outcome is not Outcome.HOLDS


SENSED = """
using Wheel:
    sensors:
        int speed
        int gear
    contract Gears:
        requires: true
        ensures: 0 <= gear' and gear' < 3

local:
    int most = 0

Look:
    pre: Wheel.gear > most
    eff: most = Wheel.gear

assume: Wheel.gear == 0

invariant Gear: forall i: most@i <= 2
invariant First: forall i: most@i <= 1
invariant Speed at round: forall i: Wheel.speed@i != 5
"""


def test_contracts_bound_what_sensors_read() -> None:
    assert said(SENSED, "Gear").outcome is Outcome.HOLDS
    first = said(SENSED, "First")
    assert first.counterexample is not None
    assert first.counterexample.round == 2


def test_a_value_that_may_be_anything_is_not_made_up() -> None:
    speed = said(SENSED, "Speed")
    assert speed.outcome is Outcome.UNKNOWN
    assert "infinitely many values" in speed.reason
    assert "speed" in speed.reason


LIST = """
allwrite:
    int[] seen = []

Add:
    pre: length(seen) < LIMIT
    eff:
        atomic: append(seen, length(seen))

invariant Short: length(seen) <= LIMIT
invariant Ordered: forall k in 0, length(seen): seen[k] == k
invariant Few: length(seen) < 6
"""


def test_lists_are_followed_as_far_as_need_be() -> None:
    text = LIST.replace("LIMIT", "10")
    for name in ("Short", "Ordered", "no fault"):
        assert said(text, name, robots=1).outcome is Outcome.HOLDS, name
    few = said(text, "Few", robots=1)
    assert few.counterexample is not None
    assert few.counterexample.round == 6


@pytest.mark.slow
def test_lists_that_are_too_long_are_told() -> None:
    short = said(LIST.replace("LIMIT", "40"), "Short", robots=1, rounds=1)
    assert short.outcome is Outcome.UNKNOWN
    assert "lists grow" in short.reason or "too much" in short.reason or short.rounds is not None


FAULTY = """
allwrite:
    int[3] a = [0, 0, 0]
    int k = 0

Next:
    pre: true
    eff:
        atomic:
            k = k + 1
            a[k] = 1

invariant Set: forall j in 0, 3: a[j] <= 1
invariant Far: k <= 2
"""


def test_behind_a_fault_there_is_nothing() -> None:
    fault = said(FAULTY, "no fault")
    assert fault.counterexample is not None
    assert fault.counterexample.round == 3
    assert said(FAULTY, "Far").outcome is Outcome.HOLDS
    assert said(FAULTY, "Set").outcome is Outcome.HOLDS


TAKEN = """
allwrite:
    int winner = -1

local:
    bool won = false
    int age = 0

Win:
    pre: winner == -1 and not won
    eff:
        atomic:
            winner = pid
            won = true

urgent Age:
    pre: age < 3
    eff: age = age + 1

invariant One: forall i, j: won@i and won@j implies i == j
invariant Together at round: forall i, j: not won@i and not won@j implies age@i == age@j
"""


def test_one_robot_wins_and_urgent_events_do_not_wait() -> None:
    for name in ("One", "Together"):
        verdict = said(TAKEN, name)
        assert (verdict.outcome, verdict.rounds) == (Outcome.HOLDS, None), name


STARTS = """
allwrite:
    int x

Keep:
    pre: x == 4
    eff:
        atomic: x = 5

assume: 1 <= x and x < 4

invariant Small: x < 4
"""


def test_what_is_assumed_of_starts_holds() -> None:
    verdict = said(STARTS, "Small")
    assert (verdict.outcome, verdict.rounds) == (Outcome.HOLDS, None)


def test_task_is_proved_with_opaque_paths() -> None:
    report = verify(of_file("task.krd", 2, tasks=2), Bounds(3), Engine.BITS)
    assert report.outcome is Outcome.HOLDS
    assert {v.engine for v in report.verdicts} == {Engine.BITS}
    assert all(v.rounds is None for v in report.verdicts)


def test_an_invariant_is_found_where_robots_change_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Exclusive is not inductive by itself, and nothing else is claimed here."""
    found: list[Sequence[Cube]] = []

    def noting(ledger: Ledger, circuit: Circuit, question: Any, cubes: Any, claims: Any) -> Lemmas:
        found.append(cubes)
        return lemmas(ledger, circuit, question, cubes, claims)

    monkeypatch.setattr(engine, "lemmas", noting)
    verdict = _exclusive_alone()
    assert (verdict.outcome, verdict.engine) == (Outcome.HOLDS, Engine.BITS)
    cubes = [each for each in found if each]
    assert len(cubes) == 1
    assert len(cubes[0]) > 10


def test_an_invariant_that_cannot_be_said_is_looked_at_clause_by_clause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[int] = []

    def noting(g: Graph, question: SafetyQuery, cubes: Sequence[Cube], deadline: Deadline) -> bool:
        found.append(len(cubes))
        return holds_always(g, question, cubes, deadline)

    monkeypatch.setattr(engine, "holds_always", noting)
    monkeypatch.setattr(engine, "lemmas", lambda *given: Lemmas((), "too long"))
    verdict = _exclusive_alone()
    assert (verdict.outcome, verdict.unsaid) == (Outcome.HOLDS, "too long")
    assert found[0] == 0  # no fault is inductive by itself
    assert len(found) == 2
    assert found[1] > 10


def _exclusive_alone() -> Verdict:
    """What the engine says of Exclusive, which is not inductive by itself, and claimed alone."""
    with open("specs/examples/task.krd", encoding="utf-8") as file:
        text = file.read()
    alone = text[: text.index("invariant Holds:")] + (
        "invariant Exclusive: forall i, j: "
        "i != j and isOnTask@i and isOnTask@j implies mine@i != mine@j\n"
    )
    return named(verify(of_text(alone, 3, tasks=3), Bounds(3), Engine.BITS), "Exclusive")


@pytest.mark.parametrize(
    ("name", "robots", "claim", "round_"),
    [
        ("broken/leader_elect_early.krd", 3, "Agree", 3),
        pytest.param("broken/allstop_alone.krd", 3, "Together", 12, marks=pytest.mark.slow),
    ],
)
def test_violations_are_replayed_and_first(name: str, robots: int, claim: str, round_: int) -> None:
    report = verify(of_file(name, robots), Bounds(20), Engine.BITS)
    shown = named(report, claim).counterexample
    assert shown is not None
    assert shown.round == round_
