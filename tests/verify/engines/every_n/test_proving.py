"""Proofs for every number of robots: what is true of all is proved, what is not never is.

Programs come in pairs: one for which a claim holds, and one that differs in what the claim rests
on. [T-EVERY-N]
"""

from __future__ import annotations

import pytest

from tests.verify.engines.every_n.asking import broken, proved, reason

LOCK = """
allwrite:
  int holder = -1
local:
  bool inside = false
Enter:
  pre: not inside and holder == -1
  eff:
    atomic:
      holder = pid
      inside = true
Leave:
  pre: inside
  eff:
    atomic:
      holder = -1
      inside = false
invariant Exclusive: forall i, j: i != j implies not (inside@i and inside@j)
invariant Owner: forall i: inside@i implies holder == i
"""


def test_a_lock_excludes_however_many_there_are() -> None:
    assert proved(LOCK) == {"Exclusive", "Owner", "no fault"}


def test_without_the_lock_nobody_is_excluded() -> None:
    without = LOCK.replace(
        "    atomic:\n      holder = pid\n      inside", "    holder = pid\n    inside"
    )
    assert "atomic" in without
    assert proved(without) == {"no fault"}
    assert broken(without, 2) == {"Exclusive", "Owner"}


def test_leaving_without_the_lock_races_with_those_who_enter() -> None:
    text = LOCK.replace(
        "      holder = -1\n      inside = false", "      holder = -1\n      inside = true"
    )
    assert "Exclusive" not in proved(text)


# --- reads are from the snapshot ------------------------------------------------------------------

VOTES = """
allread:
  bool[] said = false
local:
  bool sure = false
Say:
  eff:
    said[pid] = true
Conclude:
  pre: all(said)
  eff:
    sure = true
invariant Rightly: forall i: sure@i implies all(said)
"""


def test_what_all_have_said_is_known_of_each() -> None:
    assert proved(VOTES) == {"Rightly", "no fault"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("all(said)\n  eff", "any(said)\n  eff"),
        ("said[pid] = true", "said[pid] = not said[pid]"),
        ("all(said)\n  eff", "numAgents == 1 or said[0]\n  eff"),
    ],
)
def test_what_some_say_is_not(old: str, new: str) -> None:
    text = VOTES.replace(old, new, 1)
    assert text != VOTES
    assert "Rightly" not in proved(text)
    assert "Rightly" in broken(text, 3)


NEIGHBOURS = """
allread:
  int[] x = 0
Grow:
  pre: pid > 0 and x[pid] < x[pid - 1]
  eff:
    x[pid] = x[pid - 1]
First:
  pre: pid == 0
  eff:
    x[pid] = x[pid] + 1
invariant Falling: forall i, j: i + 1 == j implies x[j] <= x[i]
invariant Counts: forall i: 0 <= x[i]
"""


def test_neighbours_are_robots_too() -> None:
    assert proved(NEIGHBOURS) == {"Falling", "Counts", "no fault"}


GROWING = """
allread:
  int[] x = 0
Grow:
  pre: x[pid] < 3
  eff:
    x[pid] = x[pid] + 1
invariant Counts: forall i: 0 <= x[i]
"""


@pytest.mark.parametrize(
    "statement",
    [
        "exists i: x[i] >= 0 or x[i + 1] > 0",
        "exists i: i == numAgents - 1 or x[i + 1] < 0",
        "not exists i: i < numAgents - 1 and x[i + 1] < 0",
        "not exists i: x[i] < 0 and x[i + 1] < 0",
        "not exists i: forall j: i + j < numAgents implies x[i + j] < 0",
        "not exists i: exists j: x[i] < 0 and x[i + j] < 0",
    ],
)
def test_a_quantifier_holds_where_no_instance_that_counts_faults(statement: str) -> None:
    text = f"{GROWING}invariant Asked: {statement}\n"
    assert proved(text) == {"Asked", "Counts", "no fault"}
    assert broken(text, 3) == set()


@pytest.mark.parametrize(
    "statement",
    [
        "not exists i: x[i + 1] < 0",
        "not exists i: x[i] >= 0 and x[i + 1] < 0",
        "not exists i: exists j: x[i + j] < 0",
        "exists i: x[i - 1] >= 0",
    ],
)
def test_a_quantifier_with_an_instance_that_faults_does_not_hold(statement: str) -> None:
    text = f"{GROWING}invariant Asked: {statement}\n"
    assert proved(text) == {"Counts", "no fault"}
    assert broken(text, 3) == {"Asked"}


def test_a_neighbour_that_is_not_there_is_a_fault() -> None:
    ahead = NEIGHBOURS.replace("pid > 0 and x[pid] < x[pid - 1]", "x[pid] < x[pid + 1]")
    assert "no fault" not in proved(ahead)
    assert "no fault" in proved(ahead.replace("x[pid] < x", "pid < numAgents - 1 and x[pid] < x"))


# --- moments --------------------------------------------------------------------------------------


def test_what_lasts_for_half_a_round_only_is_not_proved() -> None:
    text = """
using Lamp:
  sensors:
    bool lit = false
  actuators:
    bool on = false
  environment:
    lit = on
Switch:
  eff:
    Lamp.on = not Lamp.on
invariant Always: lit == on
invariant Between at round: lit == on
"""
    assert proved(text) == {"Between", "no fault"}
    assert broken(text, 2) == {"Always"}


def test_the_environment_may_break_what_robots_keep() -> None:
    text = """
using Room:
  sensors:
    float temp = 20.0
  environment:
    temp = temp + choose(0.0, 1.0)
invariant Cool: temp <= 30.0
invariant Warm: temp >= 20.0
"""
    assert proved(text) == {"Warm", "no fault"}


def test_sensors_without_a_model_keep_nothing_but_contracts() -> None:
    text = """
using Gauge:
  sensors:
    int level
  contract Rises:
    ensures: level' >= level
assume: level >= 0
invariant Filled: level >= 0
invariant Low: level <= 5
"""
    assert proved(text) == {"Filled", "no fault"}


def test_assumptions_are_about_the_start() -> None:
    text = """
local:
  int n
Up:
  eff:
    n = n + 1
assume: n == 0
invariant Small: n <= 3
invariant Positive: n >= 0
"""
    assert proved(text) == {"Positive", "no fault"}


def test_what_each_has_need_not_be_what_all_have() -> None:
    text = """
local:
  int friend
assume: forall i: exists j: friend@i == j
invariant Somebody: 0 <= friend and friend < numAgents
invariant Same: forall i, j: friend@i == friend@j
"""
    assert proved(text) == {"Somebody", "no fault"}


def test_what_nobody_writes_stays_as_assumed() -> None:
    text = """
local:
  int limit
  int n = 0
Up:
  pre: n < limit
  eff:
    n = n + 1
assume: 0 <= limit and limit <= 5
invariant Bounded: n <= 5
"""
    assert proved(text + "invariant Below: n <= limit\n") == {"Bounded", "Below", "no fault"}


# --- urgency --------------------------------------------------------------------------------------

DEADLINE = """
using Clock
local:
  float since = 0.0
urgent Tick:
  pre: Clock.now - since >= 2.0
  eff:
    since = Clock.now
invariant Late at round: forall i: now@i - since@i <= 2.0 + delta
invariant Past: forall i: since@i <= now@i
"""


def test_urgent_events_are_not_slept_through() -> None:
    assert proved(DEADLINE) == {"Late", "Past", "no fault"}
    assert proved(DEADLINE.replace("urgent Tick", "Tick")) == {"Past", "no fault"}


def test_an_urgent_event_that_wants_a_taken_lock_may_wait() -> None:
    locked = DEADLINE.replace("    since = ", "    atomic:\n      since = ")
    assert proved(locked) == {"Past", "no fault"}


def test_inside_a_round_urgent_robots_may_not_have_moved_yet() -> None:
    text = """
local:
  int n = 0
urgent Move:
  eff:
    n = n + 1
invariant Together: forall i, j: ran(Move)@i implies ran(Move)@j
invariant After at round: forall i, j: ran(Move)@i implies ran(Move)@j
"""
    assert proved(text) == {"After", "no fault"}
    assert proved(text.replace("urgent ", "")) == {"no fault"}


# --- stopping -------------------------------------------------------------------------------------


def test_who_has_stopped_does_nothing_more() -> None:
    text = """
local:
  int n = 0
End:
  eff:
    n = n + 1
    stop
invariant Once: 0 <= n and n <= 1
invariant Told: stopped == (n == 1)
"""
    assert proved(text) == {"Once", "Told", "no fault"}
    assert proved(text.replace("    stop\n", "")) == {"no fault"}


def test_who_has_asked_to_stop_goes_on() -> None:
    text = """
local:
  int n = 0
End:
  eff:
    n = n + 1
    trystop()
invariant Once: n <= 1
invariant Together: forall i, j: stopped@i implies stopped@j
invariant After: stopped implies n >= 1
"""
    found = proved(text + "invariant Counts: n >= 0\n")
    assert "Once" not in found
    assert {"Together", "Counts"} <= found


# --- races ----------------------------------------------------------------------------------------

RACE = """
allwrite:
  int last = -1
local:
  bool wrote = false
Write:
  eff:
    last = pid
    wrote = true
invariant Some: last == -1 or exists i: last == i and wrote@i
invariant Range: -1 <= last and last < numAgents
invariant Mine: forall i: wrote@i implies last == i
"""


def test_the_last_writer_wins_whoever_that_is() -> None:
    assert proved(RACE) == {"Some", "Range", "no fault"}
    assert broken(RACE, 2) == {"Mine"}


def test_a_lock_does_not_keep_out_those_who_do_without() -> None:
    text = """
allwrite:
  int a = 0
Lock:
  eff:
    atomic:
      a = 1
Free:
  eff:
    FREE
invariant Kept: forall i: ran(Lock)@i implies a == 1
"""
    assert proved(text.replace("FREE", "stop")) == {"Kept", "no fault"}
    assert proved(text.replace("FREE", "a = 2")) == {"no fault"}


def test_an_update_that_meets_another_write_is_lost() -> None:
    text = """
allwrite:
  int n = 0
  int m = 0
Add:
  eff:
    n = n + 1
Lock:
  eff:
    atomic:
      m = m + 1
"""
    assert proved(text) == {"no fault"}
    once = text.replace("Add:\n  eff:", "Add:\n  pre: pid == 0\n  eff:")
    assert proved(once) == {"no fault", "no lost update of n"}


def test_what_two_events_write_together_stays_together() -> None:
    text = """
allwrite:
  int a = 0
  int b = 0
Both:
  eff:
    a = pid
    b = pid
invariant Alike: a == b
"""
    assert proved(text) == {"Alike", "no fault"}
    assert proved(text + "Other:\n  eff:\n    a = 0\n") == {"no fault"}


# --- kinds of robots ------------------------------------------------------------------------------

KINDS = """
local:
  int h = 0
agent Car:
  Drive:
    eff:
      h = 0
agent Drone:
  Fly:
    eff:
      h = 1
invariant Ground: forall Car c: h@c == 0
invariant Air: forall Drone d: h@d <= 1
invariant All: forall i: h@i == 0
"""


def test_kinds_are_told_apart() -> None:
    assert proved(KINDS) == {"Ground", "Air", "no fault"}
    assert broken(KINDS, 2) == {"All"}


# --- INIT -----------------------------------------------------------------------------------------


def test_init_counts() -> None:
    text = """
allread:
  int[] x = 0
allwrite:
  int first = -1
init:
  x[pid] = pid
  first = pid
invariant Own: forall i: x[i] == i
invariant Zero: forall i: x[i] == 0
invariant Somebody: exists i: first == i
invariant Nobody: first == -1
"""
    assert proved(text) == {"Own", "Somebody", "no fault"}


def test_what_is_read_before_it_is_set_is_a_fault() -> None:
    text = """
local:
  int n
  bool ready = false
Set:
  eff:
    n = 1
    ready = true
Use:
  pre: ready
  eff:
    n = n + 1
"""
    assert proved(text) == set()
    # A statement that faults is false, so this one says that it is set.
    assert proved(text + "invariant Ready: ready implies n >= 1\n") == {"Ready", "no fault"}


# --- what is not looked at ------------------------------------------------------------------------


def test_lists_of_any_length_are_not_covered() -> None:
    text = """
local:
  int[] seen = []
See:
  eff:
    append(seen, pid)
invariant Few: length(seen) <= 100
"""
    assert reason(text, "no fault") == "not covered: lists seen of more than 3 elements"


def test_a_choice_in_every_trip_is_beyond_it() -> None:
    text = """
def fun guess(int k) -> bool: extern fresh
local:
  bool lucky = false
Try:
  eff:
    for k = 0, numAgents:
      if guess(k):
        lucky = true
invariant Any: lucky or not lucky
"""
    why = reason(text, "Any")
    assert "guess" in why
    assert "loop over all robots" in why


# --- locks and locations --------------------------------------------------------------------------

IN_TURN = """
def fun free(bool[] inside) -> bool:
  for i = 0, length(inside):
    if inside[i]:
      return false
  return true
allread:
  bool[] inside = false
local:
  bool done = false
Enter:
  pre: not done
  eff:
    atomic:
      if free(inside):
        inside[pid] = true
        done = true
Leave:
  pre: done
  eff:
    inside[pid] = false
    done = false
invariant Exclusive: forall i, j: i != j implies not (inside[i] and inside[j])
invariant Known: forall i: inside[i] == done@i
"""


def test_a_block_that_writes_nothing_of_all_is_entered_by_one() -> None:
    assert proved(IN_TURN) == {"Exclusive", "Known", "no fault"}


def test_without_the_block_several_enter() -> None:
    without = IN_TURN.replace("    atomic:\n      if", "    if")
    assert "atomic" not in without
    assert proved(without) == {"Known", "no fault"}
    assert broken(without, 2) == {"Exclusive"}


PARCELS = """
def Parcel:
  int carrier = -1
  bool delivered = false
allwrite:
  Parcel[2] parcels = [Parcel(-1, false), Parcel(-1, false)]
local:
  int mine = -1
Claim:
  pre: mine == -1
  eff:
    atomic:
      for k = 0, 2:
        if parcels[k].carrier == -1 and mine == -1:
          mine = k
          parcels[k].carrier = pid
Deliver:
  pre: 0 <= mine and mine < 2
  eff:
    parcels[mine].delivered = true
    mine = -1
invariant Carried:
  forall i: mine@i == -1 or 0 <= mine@i and mine@i < 2 and parcels[mine@i].carrier == i
invariant Once: forall i, j: i != j and mine@i != -1 implies mine@i != mine@j
invariant Known: forall p in parcels: p.delivered implies p.carrier != -1
"""


def test_fields_that_only_blocks_write_are_the_winners() -> None:
    """Though others write another field of the same variable outside of them. [T-COMMIT]"""
    assert proved(PARCELS) == {"Carried", "Once", "Known", "no fault"}


@pytest.mark.parametrize(
    "write",
    [
        "parcels[0].carrier = -1",
        "parcels[0] = Parcel(-1, true)",
        "parcels = [Parcel(-1, true), Parcel(-1, true)]",
    ],
)
def test_what_is_written_outside_of_blocks_too_is_not(write: str) -> None:
    text = PARCELS.replace("parcels[mine].delivered = true", write)
    assert proved(text) <= {"no fault"}
    assert broken(text, 2) >= {"Carried", "Once"}


FLAGS = """
def Pair:
  int up = 0
  int other = 0
allwrite:
  Pair[2] pairs = [Pair(0, 0), Pair(0, 0)]
local:
  bool raised = false
Raise:
  pre: not raised
  eff:
    atomic:
      pairs[0].up = 1
      raised = true
Touch:
  pre: pairs[0].up == 0
  eff:
    pairs[0].other = 1
invariant Up: forall i: raised@i implies pairs[0].up == 1
"""


def test_what_is_touched_elsewhere_stays() -> None:
    assert proved(FLAGS) == {"Up", "no fault"}


@pytest.mark.parametrize("write", ["pairs[0].up = 0", "pairs[0] = Pair(0, 1)"])
def test_who_writes_in_a_block_may_be_overwritten_by_who_does_not(write: str) -> None:
    """In the same round: each of the two alone does no harm."""
    text = FLAGS.replace("pairs[0].other = 1", write)
    assert proved(text) == {"no fault"}
    assert broken(text, 2) == {"Up"}


ALIKE = """
using A:
  sensors:
    int x
  environment:
    if x == 0:
      x = 1
    else:
      x = 0
using B:
  sensors:
    int x
  environment:
    x = 0
local:
  bool bad = false
Go:
  pre: not bad and A.x != B.x
  eff: bad = true
assume: forall i: A.x@i == 0 and B.x@i == 0
invariant Never: forall i: not bad@i
"""


def test_sensors_of_two_modules_may_be_called_alike() -> None:
    assert proved(ALIKE) == {"no fault"}
    assert broken(ALIKE, 1) == {"Never"}


# --- what one place needs to hold, and another not to ---------------------------------------------

GATE = """
allwrite:
  bool gate = true
allread:
  bool[] inside = false
Enter:
  pre: gate and not any(inside)
  eff:
    atomic:
      gate = false
      inside[pid] = true
Leave:
  pre: inside[pid]
  eff:
    atomic:
      gate = true
      inside[pid] = false
invariant Shut: gate or exists i: inside[i]
"""


def test_what_a_guard_needs_to_fail_a_claim_may_need_to_hold() -> None:
    """Somebody is inside before the round: by the claim, and nobody by the guard."""
    assert proved(GATE) == {"Shut", "no fault"}
    assert "Shut" not in proved(GATE.replace("inside[pid] = true", "inside[pid] = false"))
