"""Sums over all robots. [T-SUM]"""

from __future__ import annotations

import pytest

from tests.sampling import but_slow
from tests.verify.engines.every_n.asking import broken, proved

COUNT = """
allread:
  bool[] done = false
allwrite:
  int count = 0
local:
  bool told = false
def fun many(bool[] who) -> int:
  int n = 0
  for k = 0, numAgents:
    if who[k]:
      n = n + 1
  return n
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
    text = """
allread:
  bool[] up = false
def fun many(bool[] who) -> int:
  int n = 0
  for k = 0, numAgents:
    if who[k]:
      n = n + 1
  return n
Raise:
  eff:
    up[pid] = true
invariant Rising: many(up) <= 1
invariant Most: many(up) <= numAgents
"""
    assert proved(text) == {"Most", "no fault"}
