"""Sums over all robots. [T-SUM]"""

from __future__ import annotations

import pytest

from koord.verify.engines.every_n.questions import GENEROUS
from tests.sampling import but_slow, first
from tests.verify.engines.every_n.asking import asked, broken, proved

#: How many of all robots are.
MANY = """\
def fun many(bool[] who) -> int:
  int n = 0
  for k = 0, numAgents:
    if who[k]:
      n = n + 1
  return n
"""

COUNT = f"""
allread:
  bool[] done = false
allwrite:
  int count = 0
local:
  bool told = false
{MANY}
Do:
  pre: not done[pid]
  eff:
    atomic:
      done[pid] = true
      count = count + 1
Tell:
  pre: count == numAgents
  eff:
    told = true
invariant Right: count == many(done)
invariant Full: forall i: told@i implies all(done)
invariant Most: count <= numAgents
"""


def test_a_counter_counts() -> None:
    assert proved(COUNT) == {"Right", "Full", "Most", "no fault"}


@pytest.mark.parametrize(
    ("old", "new", "claim"),
    but_slow(
        [
            "    atomic:\n      done[pid] = true\n      count",
            "      n = n + 1",
            "pre: not done[pid]",
            "count <= numAgents",
            "pre: count == numAgents",
        ],
        [
            ("count + 1", "count + 2", "Right"),
            ("      n = n + 1", "      n = n + 2", "Right"),
            ("pre: not done[pid]", "pre: count < numAgents", "Right"),
            ("pre: count == numAgents", "pre: count + 1 == numAgents", "Full"),
            ("count <= numAgents", "count < numAgents", "Most"),
            (
                "    atomic:\n      done[pid] = true\n      count",
                "    done[pid] = true\n    count",
                "Right",
            ),
        ],
    ),
)
def test_one_that_does_not(old: str, new: str, claim: str) -> None:
    text = COUNT.replace(old, new, 1)
    if "atomic" not in new and "atomic" in old:
        text = text.replace("      count = ", "    count = ")
    assert text != COUNT
    assert claim not in proved(text)
    assert claim in broken(text, 3, rounds=6)


SUM = """
allread:
  bool[] in_ = false
allwrite:
  int sum = 0
def fun total(bool[] who) -> int:
  int s = 0
  for k = 0, numAgents:
    if who[k]:
      s = s + PART
  return s
Add:
  pre: not in_[pid]
  eff:
    atomic:
      sum = sum + OWN
      in_[pid] = true
invariant Partial: sum == total(in_)
invariant Final: all(in_) implies sum * 6 == CLOSED
"""


def summed(part: str, own: str, closed: str) -> set[str]:
    return proved(SUM.replace("PART", part).replace("OWN", own).replace("CLOSED", closed))


def test_polynomials_have_closed_forms() -> None:
    n = "numAgents"
    both = {"Partial", "Final", "no fault"}
    assert summed("2 * k", "2 * pid", f"6 * {n} * ({n} - 1)") == both
    assert summed("3", "3", f"18 * {n}") == both
    assert summed("k * k", "pid * pid", f"({n} - 1) * {n} * (2 * {n} - 1)") == both


def test_and_no_others() -> None:
    n = "numAgents"
    assert summed("2 * k", "2 * pid", f"6 * {n} * ({n} + 1)") == {"Partial", "no fault"}


def test_several_that_change_in_one_round() -> None:
    text = f"""
allread:
  bool[] up = false
{MANY}
Raise:
  eff:
    up[pid] = true
invariant Rising: many(up) <= 1
invariant Most: many(up) <= numAgents
"""
    assert proved(text) == {"Most", "no fault"}


# --- sums that are asked of any robot -------------------------------------------------------------

ELECTION = """
using Choice:
  sensors:
    int who = 0
  environment:
    who = choose(0, numAgents - 1)
allread:
  int[] vote = -1
  bool[] leads = false
def fun votesFor(int[] votes, int who) -> int:
  int n = 0
  for k = 0, numAgents:
    if votes[k] == who:
      n = n + 1
  return n
Vote:
  pre: vote[pid] == -1
  eff:
    vote[pid] = Choice.who
Lead:
  pre: 2 * votesFor(vote, pid) > numAgents
  eff:
    leads[pid] = true
invariant Seen: forall i: leads[i] implies 2 * votesFor(vote, i) > numAgents
invariant One: forall i, j: leads[i] and leads[j] implies i == j
"""


def test_votes_for_two_robots_are_no_more_than_robots() -> None:
    assert proved(ELECTION) == {"Seen", "One", "no fault"}


@pytest.mark.parametrize(
    ("old", "new", "wrong", "robots"),
    [
        # Two of two have half of the votes each.
        ("> numAgents", ">= numAgents", {"One"}, 2),
        # Votes are counted twice.
        ("n = n + 1", "n = n + 2", {"One"}, 2),
        # Whoever has voted votes once more, for somebody else.
        ("pre: vote[pid] == -1", "pre: numAgents > 0", {"One", "Seen"}, 2),
        # It is somebody else's votes that are counted.
        ("votesFor(vote, pid)", "votesFor(vote, 0)", {"One"}, 2),
        # And then nobody's.
        pytest.param(
            "2 * votesFor(vote, i) > numAgents",
            "2 * votesFor(vote, 0) > numAgents",
            {"Seen"},
            2,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_votes_that_do_not_add_up(old: str, new: str, wrong: set[str], robots: int) -> None:
    text = ELECTION.replace(old, new)
    assert text != ELECTION
    assert not wrong & proved(text)
    assert wrong <= broken(text, robots, rounds=6)


ROOM = f"""
allread:
  bool[] near = false
  bool[] inside = false
{MANY}
Come:
  pre: not near[pid]
  eff:
    near[pid] = true
Enter:
  pre: near[pid] and not inside[pid]
  eff:
    inside[pid] = true
invariant Within: forall i: inside[i] implies near[i]
invariant Fewer: many(inside) <= many(near)
invariant Mine: forall i: inside[i] implies many(near) >= 1
"""

APART = f"""
allread:
  bool[] inside = false
  bool[] outside = false
{MANY}
Enter:
  pre: not outside[pid]
  eff:
    inside[pid] = true
Leave:
  pre: not inside[pid]
  eff:
    outside[pid] = true
invariant Not: forall i: not (inside[i] and outside[i])
invariant Both: many(inside) + many(outside) <= numAgents
"""


def shown(text: str) -> set[str]:
    """What is proved where there is time."""
    return {claim.name for claim in asked(text, GENEROUS).proved}


@pytest.mark.slow
def test_sums_are_compared_part_by_part() -> None:
    assert shown(ROOM) == {"Within", "Fewer", "Mine", "no fault"}
    assert shown(APART) == {"Not", "Both", "no fault"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("whole", "old", "new", "wrong"),
    first(
        1,
        [
            (APART, "      n = n + 1", "      n = n + 2", {"Both"}),
            (
                ROOM,
                "pre: near[pid] and not inside[pid]",
                "pre: not inside[pid]",
                {"Within", "Fewer"},
            ),
            (ROOM, "many(inside) <= many(near)", "many(near) <= many(inside)", {"Fewer"}),
            (ROOM, "many(near) >= 1", "many(near) >= 2", {"Mine"}),
            (ROOM, "      n = n + 1", "      n = n + 1\n    else:\n      n = n - 1", {"Mine"}),
            (APART, "pre: not outside[pid]", "pre: numAgents > 0", {"Not", "Both"}),
            (APART, "<= numAgents", "< numAgents", {"Both"}),
        ],
    ),
)
def test_sums_whose_parts_are_not_so(whole: str, old: str, new: str, wrong: set[str]) -> None:
    text = whole.replace(old, new)
    assert text != whole
    assert not wrong & shown(text)
    assert wrong <= broken(text, 2, rounds=6)
