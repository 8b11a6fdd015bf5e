"""Loops over all robots: what is understood of them, and that no more is believed. [T-LOOP]"""

from __future__ import annotations

import pytest

from tests.verify.engines.every_n.asking import broken, proved, reason

FLAG = """
allread:
  bool[] up = false
local:
  bool sure = false
def fun allUp(bool[] who) -> bool:
  bool found = true
  for k = 0, numAgents:
    if not who[k]:
      found = false
  return found
Raise:
  eff:
    up[pid] = true
Look:
  pre: allUp(up)
  eff:
    sure = true
invariant Sure: forall i: sure@i implies forall j: up[j]
"""


def test_a_flag_that_some_trip_clears() -> None:
    assert proved(FLAG) == {"Sure", "no fault"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("for k = 0, numAgents:", "for k = 1, numAgents:"),
        ("for k = 0, numAgents:", "for k = 0, numAgents - 1:"),
        ("if not who[k]:", "if not who[k] and k != pid_:"),
        ("if not who[k]:", "if not who[k] and k % 2 == 0:"),
        ("found = false", "found = not found"),
        ("    if not who[k]:\n      found = false", "    found = who[k]"),
    ],
)
def test_a_loop_that_leaves_some_out(old: str, new: str) -> None:
    text = FLAG.replace(old, new.replace("pid_", "1"), 1)
    assert text != FLAG
    assert "Sure" not in proved(text)
    assert "Sure" in broken(text, 3)


@pytest.mark.parametrize(
    "body",
    [
        "    if not who[k]:\n      return false\n  return true",
        "    if not who[k]:\n      found = false\n      break\n  return found",
        "    found = found and who[k]\n  return found",
    ],
)
def test_the_same_in_other_words(body: str) -> None:
    text = FLAG.replace("    if not who[k]:\n      found = false\n  return found", body)
    assert text != FLAG
    assert proved(text) == {"Sure", "no fault"}


def test_for_each_element() -> None:
    text = FLAG.replace("for k = 0, numAgents:\n    if not who[k]:", "for w in who:\n    if not w:")
    assert proved(text) == {"Sure", "no fault"}


FIRST = """
allread:
  bool[] up = false
local:
  int seen = -1
def fun firstUp(bool[] who) -> int:
  for k = 0, numAgents:
    if who[k]:
      return k
  return -1
Raise:
  pre: pid > 0
  eff:
    up[pid] = true
Look:
  eff:
    seen = firstUp(up)
invariant Up: forall i: seen@i == -1 or up[seen@i]
invariant Down: not up[0]
invariant NotZero: forall i: seen@i != 0
"""


def test_the_first_of_which_something_holds() -> None:
    assert proved(FIRST) == {"Up", "Down", "NotZero", "no fault"}
    last = FIRST.replace("      return k\n  return -1", "      seen = k\n  return seen").replace(
        "  for k = 0", "  int seen = -1\n  for k = 0", 1
    )
    # The last one is no pattern that is known, and so anything.
    assert "Up" not in proved(last)


LEAST = """
allread:
  int[] d = 0
init:
  if pid == 0:
    d[pid] = 0
  else:
    d[pid] = 5
def fun least(int[] all_, int bound) -> int:
  int best = bound
  for k = 0, numAgents:
    best = min(best, all_[k] + 1)
  return best
Relax:
  pre: least(d, 9) < d[pid]
  eff:
    d[pid] = least(d, 9)
invariant Low: forall i: 0 <= d[i]
invariant High: forall i: d[i] <= 5
invariant Zero: forall i: d[i] == 0 implies i == 0
"""


def test_the_least_of_some_numbers() -> None:
    assert proved(LEAST) == {"Low", "High", "Zero", "no fault"}


def test_the_greatest_is_something_else() -> None:
    text = LEAST.replace("best = min(", "best = max(").replace(
        "least(d, 9) < d", "d[pid] < 9 and 0 < d"
    )
    found = proved(text)
    assert "High" not in found
    assert "Low" in found


def test_only_those_that_are_looked_at_count() -> None:
    text = LEAST.replace(
        "    best = min(best, all_[k] + 1)",
        "    if all_[k] > 2:\n      best = min(best, all_[k] - 2)",
    )
    assert {"Low", "High", "no fault"} <= proved(text)
    assert "Zero" in proved(text)
    below = text.replace("all_[k] - 2", "all_[k] - 3")
    assert "Zero" not in proved(below)


FAULTS = """
allread:
  int[] x = 1
local:
  int n = 0
def fun weigh(int[] all_) -> bool:
  bool good = true
  for k = 0, numAgents:
    if 10 / all_[k] < 1:
      good = false
  return good
Set:
  eff:
    x[pid] = 2
Weigh:
  pre: weigh(x)
  eff:
    n = 1
invariant Set_: forall i: 1 <= x[i]
"""


def test_faults_in_trips() -> None:
    assert proved(FAULTS) == {"Set_", "no fault"}
    zero = FAULTS.replace("x[pid] = 2", "x[pid] = 0").replace("1 <= x[i]", "0 <= x[i]")
    assert proved(zero) == {"Set_"}
    assert "no fault" in broken(zero, 2)


def test_trips_after_the_loop_was_left_do_not_fault() -> None:
    text = """
allread:
  int[] x = 0
def fun safe(int[] all_) -> bool:
  for k = 0, numAgents:
    if k == 0:
      return true
    if 1 / all_[k] > 5:
      return false
  return false
Look:
  pre: safe(x)
  eff:
    x[pid] = 0
"""
    assert proved(text) == {"no fault"}
    assert proved(text.replace("if k == 0", "if k == 1")) == set()


def test_shared_variables_are_not_written_in_trips() -> None:
    text = """
allwrite:
  int n = 0
Add:
  eff:
    for k = 0, numAgents:
      n = n + k
invariant Positive: n >= 0
"""
    assert "writes shared variables" in reason(text, "Positive")


def test_what_loops_introduce_is_not_forgotten() -> None:
    text = """
allread:
  int[] x = 1
local:
  int last = 1
Copy:
  eff:
    for k = 0, numAgents:
      last = x[k] + 1
invariant Last: forall i: last@i <= 1
"""
    assert "Last" not in proved(text)


#: Two loops that ask the same, one of all robots, one of all but some.
TWO = """
allread:
  bool[] up = false
local:
  bool all_ = false
  bool some = false
def fun everyone(bool[] who) -> bool:
  for k = 0, numAgents:
    if not who[k]:
      return false
  return true
def fun others(bool[] who) -> bool:
  for k = LOW, HIGH:
    if not who[k]:
      return false
  return true
Raise:
  eff:
    up[pid] = true
Look:
  pre: everyone(up)
  eff:
    all_ = true
Glance:
  pre: others(up)
  eff:
    some = true
invariant All: forall i: all_@i implies forall j: up[j]
invariant Some: forall i: some@i implies forall j: up[j]
"""


@pytest.mark.parametrize(("low", "high"), [("1", "numAgents"), ("0", "numAgents - 1"), ("0", "1")])
def test_loops_that_ask_the_same_of_others(low: str, high: str) -> None:
    text = TWO.replace("LOW", low).replace("HIGH", high)
    assert "All" in proved(text)
    assert "Some" not in proved(text)
    assert "Some" in broken(text, 3)


def test_loops_that_ask_the_same_of_the_same() -> None:
    text = TWO.replace("LOW", "0").replace("HIGH", "numAgents")
    assert proved(text) == {"All", "Some", "no fault"}


#: Loops that are left where they are not where others are: the numbers of the trips count.
LEFT_AT = """
allread:
  bool[] up = false
local:
  int one = -1
  int two = -1
def fun first(bool[] who) -> int:
  for k = 0, numAgents:
    if who[k]:
      return k
  return -1
def fun second(bool[] who) -> int:
  for k = LOW, numAgents:
    if who[k]:
      return k
  return -1
Raise:
  eff:
    up[pid] = true
Look:
  pre: one == -1 and two == -1
  eff:
    one = first(up)
    two = second(up)
invariant Same: forall i: two@i == -1 or one@i == two@i
"""


def test_loops_are_left_in_the_same_trip_if_they_ask_the_same() -> None:
    assert "Same" in proved(LEFT_AT.replace("LOW", "0"))
    assert "Same" not in proved(LEFT_AT.replace("LOW", "1"))
    assert "Same" in broken(LEFT_AT.replace("LOW", "1"), 2)


#: What others are is not the same for each robot that asks.
EACH = """
allread:
  int[] level = 0
local:
  bool top = false
def fun above(int[] all_, int own) -> bool:
  for k = 0, numAgents:
    if all_[k] > own:
      return false
  return true
Rise:
  pre: not top
  eff:
    level[pid] = level[pid] + 1
Look:
  pre: above(level, level[pid])
  eff:
    top = true
invariant Top: forall i, j: top@i and top@j implies i == j
"""


def test_what_each_robot_asks_is_its_own() -> None:
    assert "Top" not in proved(EACH)
    assert "Top" in broken(EACH, 2)


#: Two rows are found, of different robots.
FOUND = """
allread:
  bool[numAgents][] rows
  bool[] differ = false
def fun first(bool[][] all_) -> bool[]:
  for k = 0, numAgents:
    if all_[k][0]:
      return all_[k]
  return all_[0]
def fun second(bool[][] all_) -> bool[]:
  for k = 0, numAgents:
    if all_[k][numAgents - 1]:
      return all_[k]
  return all_[0]
assume: forall i, j: rows[i][j] == (i == j)
Look:
  pre: numAgents > 1
  eff:
    differ[pid] = first(rows)[numAgents - 1] != second(rows)[numAgents - 1]
invariant Never: forall i: not differ[i]
"""


def test_an_array_that_a_loop_leaves_with_is_that_of_the_trip() -> None:
    assert "Never" not in proved(FOUND)
    assert "Never" in broken(FOUND, 2)
