"""Machine code makes turns as compiled robots do, or is in doubt and leaves them to these."""

from __future__ import annotations

from collections.abc import Mapping
from random import Random
from textwrap import dedent
from typing import Any

import pytest

pytest.importorskip("llvmlite")

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.engine import AtRandom, Deployed, Unheard
from koord.runtime.proposals import Attempt, EventFault, Proposal, decide, rotating
from koord.syntax.faults import FaultKind
from tests.runtime.column_twins import PlainHost, program_of, twins

COUNTING = """\
allread:
    int[] told = 0
allwrite:
    int most = 0
    pos[3] last
local:
    int k = 0
    pos here = pos(0.0, 0.0, 0.0)
    bool[2] seen
def fun third(int k, int d) -> int:
    for i = 0, 9:
        if 3 * i + d >= k:
            return i
    return -1
Tell:
    pre: told[pid] < 4 * pid and k % 3 != 1
    eff:
        told[pid] = told[pid] + third(k, 1) + 1
        k = k - 7
        here.y = here.y / 3.0 - k
        seen[k % 2] = here.y < abs(here.x)
Take:
    pre: k % 3 == 1 or most < 20
    eff:
        atomic:
            most = most + told[(pid + 1) % numAgents]
            last[k % 3] = here
        k = k + 5
        here = pos(here.y, here.x * delta, min(here.z, here.x))
Rest:
    pre: max(told) > 9 and most >= 30
    eff:
        if pid % 2 == 0:
            stop
        else:
            trystop()
"""


@pytest.mark.parametrize("robots", [1, 2, 5, 30])
def test_turns_by_code_are_those_of_robots(robots: int) -> None:
    engine = twins(COUNTING, robots, 60)
    assert engine.counts.by_code > 20 * min(robots, 5)
    assert engine.counts.by_robots == 0


@pytest.mark.parametrize("seed", range(6))
def test_so_they_are_under_any_schedule(seed: int) -> None:
    def schedule() -> Unheard:
        return Unheard(AtRandom(Random(seed)), Random(seed), 0.2, crashes=True)

    assert twins(COUNTING, 4, 40, schedules=schedule).counts.by_code > 60


@pytest.mark.parametrize("robots", [1, 4])
def test_columns_begin_as_robots_do(robots: int) -> None:
    """With what is not set, and what has more than 64 bits, of some robots or of all."""
    text = """\
    allread:
        int[] large
    local:
        int k = 0
        int unset
        int[2] both
        float x = 1
        bool b = true
    init:
        large[pid] = 9000000000000000000 * pid
        k = 100000000000000000000 + pid
        both[pid % 2] = pid
    Step:
        pre: b and x < 5.0
        eff:
            x = x + 1.0
    Count:
        pre: k > 0 and large[pid] >= 0
        eff:
            k = k / 100000000000
            unset = pid
    """
    engine = twins(dedent(text), robots, 8)
    assert engine.counts.by_code > 0
    assert engine.counts.in_doubt > 0


# --- doubt ----------------------------------------------------------------------------------------


def doubt(text: str, robots: int = 3, rounds: int = 12) -> int:
    """How many turns machine code was in doubt of; all are as robots make them."""
    engine = twins(text, robots, rounds)
    assert engine.counts.by_robots == 0
    return engine.counts.in_doubt


def ended_in_doubt(text: str, robots: int, rounds: int) -> ColumnEngine:
    """The engine of a run that ends early, after turns that code was in doubt of."""
    engine = twins(text, robots, rounds)
    assert engine.ended is not None
    assert engine.counts.in_doubt > 0
    return engine


@pytest.mark.parametrize(
    ("start", "change"),
    [
        ("2305843009213693952", "x + x"),
        ("-2305843009213693952", "x - 4611686018427387904"),
        ("3037000500", "x * x"),
        ("-9223372036854775807", "-(x - 1)"),
        ("-9223372036854775807", "abs(x - 1)"),
        ("-9223372036854775807", "(x - 1) / (k - 1)"),
    ],
)
def test_integers_of_more_than_64_bits_are_left_to_robots(start: str, change: str) -> None:
    text = f"local:\n    int x = {start}\n    int k = 0\n"
    text += f"Go:\n    pre: k < 4\n    eff:\n        x = {change}\n        k = k + 1\n"
    assert doubt(text) > 0


def test_what_is_no_number_is_kept_by_robots_alone() -> None:
    text = "local:\n    float x = 1.0e308\n    float y = 0.0\n    int k = 0\n"
    text += "Go:\n    pre: k < 5 and not (y > 1.0)\n"
    text += "    eff:\n        x = x * 10.0\n        y = x - x\n        k = k + 1\n"
    assert doubt(text) >= 3 * 5


@pytest.mark.parametrize(
    "fault",
    ["a[k - 2]", "a[3 - k]", "told[k]", "a[0] / (k - 4)", "a[0] % (k - 4)", "b", "p.y"],
)
@pytest.mark.parametrize("where", ["guard", "effect"])
def test_faults_are_those_of_robots(fault: str, where: str) -> None:
    """In a guard, of a robot that has an event besides; in an effect, behind others' turns."""
    text = "allread:\n    int[] told = 0\n"
    text += "local:\n    int[3] a\n    int k = 0\n    int b\n    pos p\n    float f = 0.0\n"
    text += "init:\n    p.x = 1.0\n    a[0] = 1\n    a[1] = 2\n    a[2] = 3\n"
    read = f"{fault} > -9.0" if fault == "p.y" else f"{fault} > -9"
    guard = f"k > 1 - pid % 2 and {read} and k < 9" if where == "guard" else "k >= 3"
    text += f"Bad:\n    pre: {guard}\n    eff:\n        k = k + 1\n"
    if where == "effect":
        text += f"        if {read}:\n            told[pid] = 7\n"
    text += "Good:\n    pre: a[0] + a[1] + a[2] > 0\n"
    text += "    eff:\n        told[pid] = k\n        k = k + 1\n"
    assert ended_in_doubt(text, 3, 12).counts.by_code > 0


def test_a_doubtful_event_comes_before_one_that_is_enabled() -> None:
    """And of two events of which both are sure, the first one runs."""
    text = "local:\n    int k = 4611686018427387904\n    int m = 0\n    int n = 0\n"
    text += "First:\n    pre: k + k > 0 and m < 3\n    eff:\n        m = m + 1\n"
    text += "Second:\n    pre: n < 9\n    eff:\n        n = n + 1\n"
    text += "Third:\n    pre: n < 20\n    eff:\n        n = n + 2\n"
    assert doubt(text) == 3 * 12


def test_quotients_are_rounded_down() -> None:
    text = "local:\n    int k = -9\n    int[4] q\n"
    text += "Go:\n    pre: k < 10\n    eff:\n        q[0] = k / 4\n        q[1] = k % 4\n"
    text += "        if k != 0:\n            q[2] = 7 / k\n            q[3] = 7 % k\n"
    text += "        k = k + 1\n"
    assert doubt(text, 1, 30) == 0


def test_lists_that_are_written_there_are_elements() -> None:
    text = "param int[] steps = [3, 1, 4, 1, 5]\nlocal:\n    int k = 0\n    int sum = 0\n"
    text += "    float x = 0.5\n    bool known = false\n    int[3] a\n"
    text += "    pos p = pos(1.0, 0.0, 0.0)\n    bool there = false\n"
    text += "init:\n    a[0] = 4\n    a[1] = 2\n    a[2] = 7\n"
    text += "Go:\n    pre: k < length(steps) + pid and not (k == 3 and contains(steps, k + 9))\n"
    text += "    eff:\n        for step in steps:\n            if step > k:\n"
    text += "                break\n            sum = sum + step\n"
    text += "        known = contains([1.5, x, -x], 0.0 - x) and contains(a, k)\n"
    text += "        x = max([x, 0.25 * k]) - min(a)\n"
    text += "        sum = sum + steps[(k + pid) % 5] * steps[k % 4]\n"
    text += "        there = contains([pos(0.25 * k, 0.0, 0.0)], p)\n"
    text += "        a[k % 3] = sum\n        k = k + 1\n"
    assert doubt(text, 3, 12) == 0


def test_written_lists_end_where_they_end() -> None:
    text = "local:\n    int k = 0\n    int m = 0\n"
    text += "Go:\n    eff:\n        m = [7, k, 9][k - 1 + pid]\n        k = k + 1\n"
    ended_in_doubt(text, 2, 6)


def test_a_function_forgets_what_it_has_stored() -> None:
    text = "local:\n    int k = 0\ndef fun f(int k) -> int:\n    int x\n    if k > 2:\n"
    text += "        x = 1\n    return x\n"
    text += "Go:\n    eff:\n        for i = 0, 2:\n            k = k + f(3 - i)\n"
    ended_in_doubt(text, 2, 4)


def test_zeros_keep_their_signs() -> None:
    text = "using M:\n    sensors:\n        float a\n        float b\n"
    text += "local:\n    float least = 1.0\n    float most = 1.0\n    float turned = 1.0\n"
    text += "Go:\n    eff:\n        least = min(M.a, M.b)\n        most = max(M.a, M.b)\n"
    text += "        turned = -M.a * 1.0\n"
    zeros = [0.0, -0.0]

    def reading(robot: int, round_: int) -> Mapping[str, Any]:
        return {"M_a": zeros[round_ % 2] + 0.0 * robot, "M_b": zeros[(round_ + robot) % 2]}

    engine = twins(text, 3, 8, reading)
    assert engine.counts.in_doubt == 0
    assert {repr(vars(robot)["turned"]) for robot in engine.robots} <= {"0.0", "-0.0"}


@pytest.mark.parametrize(("a", "n"), [(float("nan"), 1), (1.0, 2**70)])
def test_what_is_sensed_may_be_in_doubt(a: float, n: int) -> None:
    text = "using M:\n    sensors:\n        float a\n        int n\n"
    text += "local:\n    int k = 0\n"
    text += "Go:\n    pre: M.a < 3.0 and M.n > 5\n    eff:\n        k = k + M.n\n"

    def reading(robot: int, round_: int) -> Mapping[str, Any]:
        if (round_ + robot) % 3 == 0:
            return {"M_a": a, "M_n": n}
        return {"M_a": float(round_) - 2.0, "M_n": 4 + round_}

    engine = twins(text, 4, 9, reading)
    assert engine.counts.in_doubt > 6
    assert engine.counts.by_code > 6


def test_a_guard_without_code_leaves_its_robots_to_themselves() -> None:
    text = "local:\n    int k = 0\n    int[] list = []\n"
    text += "Listed:\n    pre: length(list) > 0\n    eff:\n        k = 0\n"
    text += "Go:\n    eff:\n        k = k + 1\n"
    engine = twins(text, 3, 4)
    assert engine.counts.by_robots == 3 * 4
    assert engine.counts.in_doubt == engine.counts.by_code == 0


def test_what_is_too_long_is_left_to_robots() -> None:
    """Calls are written out: twelve functions of which each calls the one before twice."""
    text = "local:\n    int k = 0\ndef fun f0(int k) -> int:\n    return k % 2\n"
    for level in range(1, 12):
        text += f"def fun f{level}(int k) -> int:\n"
        text += f"    return (f{level - 1}(k) + f{level - 1}(k + 1)) % 5\n"
    text += "Short:\n    pre: k % 2 == 0\n    eff:\n        k = k + 1\n"
    text += "Long:\n    pre: k % 2 == 1\n    eff:\n        k = k + 1 + 2 * f11(k)\n"
    engine = twins(text, 2, 8)
    assert engine.counts.by_robots == engine.counts.by_code == 2 * 4


def test_what_asks_others_or_writes_to_streams_is_left_to_robots() -> None:
    text = "local:\n    int k = 0\n    int[] list = []\nOften:\n    pre: k % 2 == 0\n"
    text += "    eff:\n        k = k + 1\nOnce:\n    pre: k % 2 == 1\n"
    text += "    eff:\n        append(list, k)\n        k = k + 1\n"
    engine = twins(text, 3, 8)
    assert engine.counts.by_robots == 3 * 4
    assert engine.counts.by_code == 3 * 4


# --- who is let through ---------------------------------------------------------------------------

LOCKS = """\
allwrite:
    int one = 0
    int other = 0
local:
    int k = 0
Both:
    pre: (k + pid) % 3 == 0
    eff:
        atomic:
            one = one + 1
        k = k + 1
        atomic:
            other = pid
Single:
    pre: (k + pid) % 3 == 1
    eff:
        atomic:
            other = other * 2 + pid
        k = k + 1
Neither:
    eff:
        k = k + 1
"""


def test_locks_let_through_whom_they_should() -> None:
    engine = twins(LOCKS, 5, 40)
    assert engine.counts.in_doubt == engine.counts.by_robots == 0
    assert engine.store.values["one"] > 5


URGENT = """\
allwrite:
    int turn = 0
local:
    int k = 4611686018427387904
    int m = 0
urgent Late:
    pre: m % 3 == 2 and (pid > 1 or k + k > 0)
    eff:
        m = m + 1
Usual:
    eff:
        atomic:
            turn = turn + 1
        m = m + 1
urgent Last:
    pre: m % 4 == 1 and (pid != 2 or k + k > 0)
    eff:
        m = m + 2
        k = k + 1
"""


@pytest.mark.parametrize("seed", range(8))
def test_events_that_are_owed_are_run(seed: int) -> None:
    """One alone by machine code; of several, and of one in doubt, robots make attempts."""

    def schedule() -> Unheard:
        return Unheard(AtRandom(Random(seed), 50), Random(seed), 0.3, crashes=False)

    for engine in (twins(URGENT, 4, 25), twins(URGENT, 4, 25, schedules=schedule)):
        assert engine.counts.by_robots > 0
        assert engine.counts.by_code > 20


@pytest.mark.parametrize("seed", range(30))
def test_decisions_are_those_of_the_rules(seed: int) -> None:
    from koord.runtime.columns.deciding import decided

    rng, robots = Random(seed), 12
    proposals = {}
    for robot in range(robots):
        if rng.random() < 0.6:
            locks = tuple(sorted(rng.sample(range(4), rng.randrange(3))))
            fault = EventFault(FaultKind.INDEX, "1:1") if rng.random() < 0.06 else None
            attempts = (Attempt(rng.randrange(3), (), locks, fault=fault),)
            proposals[robot] = Proposal(robot, 3, attempts if rng.random() < 0.9 else ())
    order = rng.sample(range(robots), robots)
    assert decided(3, proposals, order) == decide(3, proposals, order)
    assert decided(3, proposals, rotating(3, robots)) == decide(3, proposals, rotating(3, robots))


def test_without_llvmlite_robots_make_all_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "koord.runtime.compile.machine.turns", None)
    engine = twins(COUNTING, 3, 20)
    assert engine.fleet is None
    assert engine.counts.by_code == 0


def test_large_fleets_make_code_at_once() -> None:
    """Where one round has more turns than make code worth its time."""
    program = program_of(COUNTING)
    turns, kinds = LazyTurns(program), (0,) * 11
    given = (loaded(compiled(program)), kinds, 0.1, PlainHost(lambda robot, round_: {}), turns)
    engine = ColumnEngine(*given, after=10)
    engine.begin()
    engine.program_turns(Deployed())
    assert turns.is_made
    assert engine.counts.by_code == 11


def test_short_runs_make_no_code() -> None:
    program = program_of(COUNTING)
    turns = LazyTurns(program)
    given = (loaded(compiled(program)), (0, 0), 0.1, PlainHost(lambda robot, round_: {}), turns)
    engine = ColumnEngine(*given, after=10)
    engine.begin()
    for round_ in range(7):
        assert turns.is_made == (round_ > 5)
        engine.program_turns(Deployed())
        engine.environment_turn()
