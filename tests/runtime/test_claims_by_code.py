"""Machine code is sure of claims only where they hold, and compiled claims say what does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import pytest

pytest.importorskip("llvmlite")

from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.watching import WatchedKind, watched
from koord.runtime.engine import Deployed
from koord.runtime.monitors import StateMonitor
from koord.runtime.watch import Watch
from koord.syntax import core
from tests.runtime.column_twins import PlainHost, program_of

#: Robots that hold what their sensors have read, and tell some of it.
HOLDING = """\
using Sensing:
    sensors:
        int n
        float f
        bool b
        pos p
allread:
    int[] told = 0
    pos[] at = pos(0.0, 0.0, 0.0)
allwrite:
    int most = 0
    float last
local:
    int k = 0
    float x
    pos[2] spots
def fun half(int k, float x) -> float:
    if k > 3:
        return x / 2.0
    return x
def fun near(pos p, float x) -> bool:
    return abs(p.x) <= x and p.y <= x
Hold:
    pre: Sensing.b
    eff:
        k = Sensing.n
        told[pid] = Sensing.n % 5
        at[pid] = Sensing.p
        x = Sensing.f
        spots[Sensing.n % 2] = Sensing.p
        if Sensing.n > most:
            most = Sensing.n
        if Sensing.n == 4:
            last = Sensing.f
"""

Reading = Callable[[int, int], Mapping[str, Any]]


def readings(seed: int) -> Reading:
    """What sensors read, which hangs on a number alone."""

    def read(robot: int, round_: int) -> Mapping[str, Any]:
        mixed = (seed * 7919 + robot * 104_729 + round_ * 1_299_709) % 10_007
        place = ((mixed % 7) / 2.0 - 1.0, (mixed % 11) / 4.0, 0.0)
        read_f = -0.0 if mixed % 13 == 0 else (mixed % 9) / 3.0
        return {
            "Sensing_n": mixed % 6,
            "Sensing_f": read_f,
            "Sensing_b": mixed % 3 > 0,
            "Sensing_p": place,
        }

    return read


class Judged:
    """A run whose claims are looked at by both in each round, and what came of it."""

    def __init__(
        self, text: str, robots: int, reading: Reading, slack: Fraction = Fraction(0)
    ) -> None:
        program = program_of(text)
        claims = watched(program, slack)
        kinds = core.round_robin(robots, len(program.agents))
        host = PlainHost(reading)
        turns = LazyTurns(program, claims)
        self.engine = ColumnEngine(loaded(compiled(program)), kinds, 0.1, host, turns, after=0)
        (made,) = loaded(claims.text)
        assert issubclass(made, Watch)
        self.claims = claims
        self.monitors = [
            StateMonitor(made(kinds, 0.1, host), claims.claims, kinds) for _ in range(2)
        ]
        self.broken = self.sure = self.unsure = 0
        self.coded: set[str] = set()

    def run(self, rounds: int) -> Judged:
        engine = self.engine
        engine.begin()
        self._look(None)
        for _ in range(rounds):
            if engine.ended is not None or engine.all_stopped:
                break
            decision = engine.program_turns(Deployed())
            self._look({taken.robot for taken in decision.ran})
            engine.environment_turn()
            self._look(None)
        return self

    def _look(self, only: set[int] | None) -> None:
        """Look at all claims by both, and compare what they say."""
        engine, (plain, by_code) = self.engine, self.monitors
        if engine.ended is not None:
            return
        judge = engine.judge(self.claims)
        plain.see(engine.robots, engine.store.values, only)
        by_code.see(engine.robots, engine.store.values, only, judge)
        one, other = ([*monitor.broken(WatchedKind)] for monitor in (plain, by_code))
        assert [(c.name, pids) for c, pids in one] == [(c.name, pids) for c, pids in other]
        assert plain.looked == by_code.looked
        assert plain.unknown == by_code.unknown
        self.broken += len(one)
        if judge is None:
            return
        for claim in self.claims.claims:
            unsure = judge.unsure(claim.method)
            if unsure is None:
                continue
            self.coded.add(claim.name)
            count = math.prod(
                sum(agent in (None, kind) for kind in engine.robots[0].kinds)
                for agent in claim.agents
            )
            assert len(set(unsure)) == len(unsure) <= count
            assert {pids for c, pids in one if c is claim} <= set(unsure)
            self.sure += count - len(unsure)
            self.unsure += len(unsure)


CLAIMS = """\
invariant Told: told[pid] <= k
invariant Near: abs(at[pid].x - Sensing.p.x) <= 2 and at[pid].y >= 0.0
invariant Most: most < 5
invariant Pairs: forall i: forall j: k@i - k@j < 5 or i == j
invariant Each: forall i: exists j: told[j] >= k@i % 5
invariant Some: exists i: k@i > 2
invariant Halves: forall i: half(k@i, Sensing.f@i) <= 2.0
invariant Places: forall i: near(at[i], 1.5)
invariant Twice: forall i: k@i < 5 implies (forall j: told[j] + k@i < 9)
"""


@pytest.mark.parametrize("robots", [1, 2, 7, 40])
def test_claims_by_code_are_broken_where_compiled_ones_are(robots: int) -> None:
    judged = Judged(HOLDING + CLAIMS, robots, readings(robots)).run(12)
    assert judged.coded == {claim.name for claim in judged.claims.claims}
    assert judged.broken > 0
    assert judged.sure > 0


def test_claims_have_slack_by_code_too() -> None:
    strict, loose = (
        Judged(HOLDING + CLAIMS, 5, readings(1), Fraction(slack)).run(12) for slack in (0, 2)
    )
    assert loose.coded == strict.coded
    assert 0 < loose.broken < strict.broken


# --- doubt ----------------------------------------------------------------------------------------


def in_doubt(claim: str, robots: int = 3) -> Judged:
    judged = Judged(f"{HOLDING}invariant One: {claim}\n", robots, readings(3)).run(8)
    assert judged.coded == {"One"}
    return judged


@pytest.mark.parametrize(
    "claim",
    [
        "forall i: x@i <= 100.0",  # not set at first
        "last <= 100.0 or most < 0",  # not set at first, and nobody's
        "forall i: 6 / (k@i - 2) < 100",
        "forall i: 6 % (k@i - 2) < 100",
        "forall i: 1.0 / Sensing.f@i < 1000.0",
        "forall i: told[k@i] < 100",
        "forall i: k@(k@i) < 100",
        "forall i: told[k@i - 2] < 100",
        "forall i: spots@i[k@i - 3].x < 100.0",
        "forall i: k@i * 9000000000000000000 >= 0",
        "forall i: forall j: told[i + j] < 100",
    ],
)
def test_what_faults_or_is_not_set_is_left_to_compiled_claims(claim: str) -> None:
    judged = in_doubt(claim)
    assert judged.unsure > 0


def test_doubt_is_not_a_breach() -> None:
    """An integer of more than 64 bits is as good as any other."""
    judged = in_doubt("forall i: k@i * 9000000000000000000 >= 0")
    assert judged.unsure > 0
    assert judged.broken == 0


def test_zeros_of_both_signs_are_equal() -> None:
    judged = in_doubt("forall i: Sensing.f@i >= 0.0 and (Sensing.f@i != 0.0 or k@i < 9)")
    assert judged.broken == judged.unsure == 0
    assert judged.sure > 0


def test_where_more_are_broken_than_have_room_compiled_claims_look() -> None:
    judged = Judged(f"{HOLDING}invariant All: forall i: forall j: k@i + k@j < 0\n", 30, readings(2))
    judged.run(3)
    assert judged.coded == set()
    assert judged.broken > 2 * 30 * 3


@pytest.mark.parametrize(
    "claim",
    [
        "forall i: not stopped@i",
        "forall i: forall j: forall m: k@i + k@j + k@m < 12",
        "forall i: ran(Hold)@i implies k@i < 5",
    ],
)
def test_what_has_no_code_is_looked_at_as_before(claim: str) -> None:
    judged = Judged(
        f"{HOLDING}invariant One: {claim}\ninvariant Two: forall i: k@i < 5\n", 4, readings(5)
    ).run(10)
    assert judged.coded == {"Two"}
    assert judged.broken > 0


KINDS = """\
agent A:
    local:
        int k = 0
        int own = 3
    Step:
        pre: k < 9
        eff:
            k = k + 2
agent B:
    local:
        bool flag = false
        int k = 1
    Step:
        pre: k < 9
        eff:
            k = k + 3
            flag = true
invariant Every: forall i: k@i < 9
invariant OfA: forall A i: own@i == 3 and k@i % 2 == 0
invariant OfB: forall B i: flag@i or k@i == 1
invariant Both: forall A i: forall B j: k@i <= k@j + 1
"""


def test_kinds_of_robots_have_columns_of_their_own() -> None:
    judged = Judged(KINDS, 5, lambda robot, round_: {}).run(6)
    assert judged.coded == {"Every", "OfA", "OfB", "Both"}
    assert judged.broken > 0
    assert judged.sure > 0


def test_a_judge_has_claims_of_its_own_only() -> None:
    judged = Judged(HOLDING + CLAIMS, 2, readings(1)).run(2)
    program = program_of(f"{HOLDING}invariant Told: told[pid] > k\n")
    assert judged.engine.judge(judged.claims) is not None
    assert judged.engine.judge(watched(program, Fraction(0))) is None


def test_changes_that_nobody_asked_about_are_found_later() -> None:
    """Who looks at a claim less often is told of all robots that have changed meanwhile."""
    claim = "forall i: not stopped@i and k@i < 5"
    several = "forall i: forall j: forall m: k@i + k@j + k@m < 12"
    text = f"{HOLDING}invariant One: {several}\ninvariant Two: {claim}\n"
    judged = Judged(text, 6, readings(5)).run(3)
    engine, (plain, by_code) = judged.engine, judged.monitors
    for looks_at in ((), WatchedKind) * 4:
        ran = {taken.robot for taken in engine.program_turns(Deployed()).ran}
        judge = engine.judge(judged.claims)
        assert judge is not None
        plain.see(engine.robots, engine.store.values)
        by_code.see(engine.robots, engine.store.values, ran, judge)
        one, other = ([*monitor.broken(looks_at)] for monitor in (plain, by_code))
        assert one == other
        engine.environment_turn()
    assert one


# --- any claims -----------------------------------------------------------------------------------

_INTS = st.sampled_from(["k@i", "told[i]", "most", "i", "Sensing.n@i", "told[k@i]", "2", "0", "7"])
_FLOATS = st.sampled_from(
    ["Sensing.f@i", "Sensing.p@i.x", "at[i].y", "x@i", "last", "spots@i[0].x", "0.5", "delta"]
)
_TESTS = st.sampled_from(["<", "<=", "==", "!=", ">", ">="])


def _ints(depth: int) -> st.SearchStrategy[str]:
    if not depth:
        return _INTS
    inner = _ints(depth - 1)
    return st.one_of(
        _INTS,
        st.builds("({} {} {})".format, inner, st.sampled_from("+-*/%"), inner),
        st.builds("min({}, {})".format, inner, inner),
        st.builds("abs({})".format, inner),
    )


def _floats(depth: int) -> st.SearchStrategy[str]:
    if not depth:
        return _FLOATS
    inner = _floats(depth - 1)
    return st.one_of(
        _FLOATS,
        st.builds("({} {} {})".format, inner, st.sampled_from("+-*/"), inner),
        st.builds("max({}, {})".format, inner, inner),
        st.builds("half({}, {})".format, _ints(0), inner),
    )


def _truths(depth: int) -> st.SearchStrategy[str]:
    plain = st.one_of(
        st.builds("{} {} {}".format, _ints(2), _TESTS, _ints(1)),
        st.builds("{} {} {}".format, _floats(2), _TESTS, _floats(1)),
        st.just("Sensing.b@i"),
        st.just("near(at[i], 1.0)"),
    )
    if not depth:
        return plain
    inner = _truths(depth - 1)
    return st.one_of(
        plain,
        st.builds("({} {} {})".format, inner, st.sampled_from(["and", "or", "implies"]), inner),
        st.builds("not ({})".format, inner),
        st.builds("(exists j: told[j] > k@i and ({}))".format, inner),
        st.builds("(forall j: k@j < 5 or ({}))".format, inner),
    )


@given(
    claims=st.lists(_truths(2), min_size=1, max_size=4),
    robots=st.integers(1, 6),
    seed=st.integers(0, 99),
)
def test_any_claims_by_code_are_broken_where_compiled_ones_are(
    claims: list[str], robots: int, seed: int
) -> None:
    stated = [f"invariant C{k}: forall i: {claim}\n" for k, claim in enumerate(claims)]
    judged = Judged(HOLDING + "".join(stated), robots, readings(seed)).run(5)
    assert judged.coded == {f"C{k}" for k in range(len(claims))}
