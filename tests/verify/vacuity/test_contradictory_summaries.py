"""Summaries that speak of every value of a type. [EXTERNAL] [E-QUANT]"""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.sampling import sampled_inputs
from koord.syntax import core
from koord.verify.claims import claims_of
from koord.verify.engine_names import Engine
from koord.verify.promises import unkept
from koord.verify.verdicts import Outcome
from koord.verify.witness import replayed
from tests.loading import program_of
from tests.verify.asking import Answers, ask, bounded, system_of

HOLDS, VIOLATED, UNKNOWN = Outcome.HOLDS, Outcome.VIOLATED, Outcome.UNKNOWN


def once(declared: str, variables: str, effect: str, *invariants: str) -> core.Program:
    """A program whose robots do one thing, once."""
    lines = [declared, "local:", *(f"    {v}" for v in variables.split("; "))]
    lines += ["    bool done = false", "Go:", "    pre: not done", "    eff:"]
    lines += [f"        {s}" for s in effect.split("; ")] + ["        done = true"]
    return program_of("\n".join([*lines, *(f"invariant {i}" for i in invariants)]) + "\n")


def outcomes(answers: Answers) -> dict[str, Outcome]:
    return {v.claim.name: v.outcome for v in answers if v.claim.name != "no fault"}


MODE = "enum Mode: idle, pick, drop\n"

NEAR = """
def fun near(int p, int[] a) -> bool: extern
    ensures:
        result implies contains(a, p)
        forall int q: contains(a, q) implies near(q, a)
"""


def test_every_value_of_an_enumeration_is_one_of_its_members() -> None:
    """A statement about all of them is about no other number."""
    declared = f"""{MODE}
def fun kind(Mode m, int a) -> int: extern
    ensures: forall Mode k: (k == idle or k == pick or k == drop) and result >= 0
def fun free(int a) -> Mode: extern fresh
    ensures: forall Mode k: k == idle or k == pick or k == drop
"""
    program = once(
        declared,
        "int x = 0; Mode m = idle",
        "x = kind(pick, 3); m = free(1)",
        "Zero: x == 0",
        "Natural: x >= 0",
        "Idle: m == idle",
    )
    for choice in (None, Engine.BMC):
        found = outcomes(ask(program, robots=1, rounds=2, choice=choice))
        assert found == {"Zero": VIOLATED, "Natural": HOLDS, "Idle": VIOLATED}, choice


def test_an_answer_that_is_the_best_of_all() -> None:
    """An answer that is made up anew each time, of a summary about every value."""
    declared = f"""{MODE}
def fun size(Mode m) -> int: extern
def fun best(int n) -> Mode: extern fresh
    ensures: forall Mode m: size(result) >= size(m)
"""
    invariants = (
        "Best: done implies size(m) >= size(pick)",
        "More: done implies size(m) > size(pick)",
    )
    program = once(declared, "Mode m = idle", "m = best(1)", *invariants)
    assert outcomes(ask(program, robots=1, rounds=2)) == {"Best": HOLDS, "More": VIOLATED}


@pytest.mark.slow
def test_functions_of_lists_are_asked_about_every_value() -> None:
    """What they answer depends on the value, though lists are held in many shapes."""
    invariants = "One: done implies b", "Three: not c", "Never: not b"
    effect = "b = near(1, xs); c = near(3, xs)"
    program = once(NEAR, "int[] xs = [1, 2]; bool b = false; bool c = false", effect, *invariants)
    found = outcomes(ask(program, robots=2, rounds=2))
    assert found == {"One": HOLDS, "Three": HOLDS, "Never": VIOLATED}


def test_lists_that_are_built_in_different_ways_are_one_question() -> None:
    """[E-EQUAL]: also where functions are symbols of the solver."""
    variables = "int[] xs = []; int n = 0; bool b = false; bool c = false"
    effect = "append(xs, n); append(xs, 5); b = near(7, xs); c = near(7, [0, 5])"
    program = once(NEAR, variables, effect, "Same: b == c", "Else: done implies b")
    assert outcomes(ask(program, robots=1, rounds=2)) == {"Same": HOLDS, "Else": VIOLATED}


@pytest.mark.slow
def test_every_list() -> None:
    """Proofs need a few of the lists only; so they hold however long others are."""
    declared = """
def fun total(int[] a) -> int: extern
    ensures: forall int[] b: length(b) > length(a) implies total(b) > result
"""
    effect = "t = total([1]); u = total([5, 6])"
    program = once(
        declared, "int t = 0; int u = 0", effect, "Up: done implies t < u", "Down: t > u"
    )
    assert outcomes(ask(program, robots=1, rounds=2)) == {"Up": HOLDS, "Down": VIOLATED}


def test_a_function_of_maps_that_is_asked_about_every_value_is_unknown() -> None:
    declared = """
def fun known(int p, Map<int, int> m) -> bool: extern
    ensures: forall int q: known(q, m) implies result
"""
    variables = "Map<int, int> m = {}; bool b = false"
    opaque = once(declared, variables, "b = known(1, m)", "No: not b")
    assert ask(opaque, robots=1, rounds=2, choice=Engine.BMC)["No"].outcome is VIOLATED
    program = once(declared, variables, "m[1] = 2; b = known(1, m)", "No: not b")
    for choice in (Engine.BMC, Engine.INDUCTION, Engine.SPACER):
        asked = ask(program, robots=1, rounds=2, choice=choice)
        assert asked["No"].outcome is UNKNOWN
        why = "a map, as m is, in a question about every value of a type"
        assert why in asked["No"].reason
        assert not asked.report.failures  # it is a limit, and no mistake
    # Bits make no formula of the question: `known` may be true of everything.
    assert ask(program, robots=1, rounds=2)["No"].outcome is VIOLATED


def test_a_run_that_breaks_a_promise_about_every_value_is_not_shown() -> None:
    """[REPLAY]: a candidate that a replay would take on trust, from positions made opaque."""
    declared = """
def fun clear(pos[] a) -> bool: extern
    ensures: forall pos[] b: length(b) < length(a) and result implies clear(b)
"""
    effect = "b = clear([p, p]); c = clear([p])"
    variables = "pos p = pos(0, 0, 0); bool b = false; bool c = false"
    program = once(declared, variables, effect, "Less: b implies c", "More: c implies b")
    assert outcomes(ask(program, robots=1, rounds=2)) == {"Less": HOLDS, "More": VIOLATED}
    assert bounded(program, robots=1, rounds=1).rounds == {"More": 1}


def test_answers_that_nobody_asks_for_break_no_promise() -> None:
    """[REPLAY]: a solver gives them for branches that are not taken."""
    declared = """
def fun clear(pos[] a) -> bool: extern
    ensures: forall pos[] b: length(b) < length(a) and result implies clear(b)
def fun tails(int n) -> bool: extern
"""
    variables = "pos p = pos(0, 0, 0); bool b = false; bool c = true"
    effect = "b = tails(1); c = (b and clear([p, p, p])) or clear([p, p])"
    of = system_of(once(declared, variables, effect, "Clear: c"), 1)
    shown = bounded(of, rounds=1).violated["Clear"]
    (round_,) = shown.recording.rounds
    tails, longer, shorter = round_.answers
    assert shorter.value is False
    answers = (replace(tails, value=False), replace(longer, value=True), shorter)
    recording = replace(shown.recording, rounds=(replace(round_, answers=answers),))
    (claim,) = [c for c in claims_of(of) if c.name == "Clear"]
    assert replayed(of, recording, claim, shown.phase).round == 1
    assert unkept(of, answers) is not None  # had both been asked for


def test_a_summary_that_nothing_meets_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is about one answer, about other answers, or about every value."""
    monkeypatch.setattr(sampled_inputs, "TRIES", 20)  # they are all in vain
    for promise in (
        "result > a and result < a",
        "f(a) == result and f(a) > result",
        "forall int q: result > q",
    ):
        declared = f"def fun f(int a) -> int: extern\n    ensures: {promise}\n"
        asked = ask(once(declared, "int x = 0", "x = f(1)", "Zero: x == 0"), robots=1, rounds=2)
        assert any("no answer of f can meet its `ensures`" in told for told in asked.empty), promise


def test_a_summary_that_something_meets_is_not() -> None:
    declared = """
def fun f(int a) -> int: extern
    requires: a > 0
    ensures: result > a
def fun g(int[] a) -> int: extern
    ensures: length(a) > 3 and result == 1
"""
    program = once(declared, "int x = 0", "x = f(1) + g([1])", "Any: x >= 0")
    asked = ask(program, robots=1, rounds=2, choice=Engine.BMC)
    assert not any("can meet its" in told for told in asked.empty)
