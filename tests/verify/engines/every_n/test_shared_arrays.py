"""Arrays over robots whose elements any robot may write: proofs for every number of robots.

What is proved of generated programs no search for one to three robots refutes. [T-EVERY-N]
[T-COMMIT]
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.verify.claims import claims_of
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from tests.sampling import sampled
from tests.verify.asking import name_of
from tests.verify.engines.every_n.asking import broken, proved, system_of

TOKEN = """
allwrite:
  bool[numAgents] message
local:
  bool holds
init:
  holds = pid == 0
assume: forall i: not message[i]
Send:
  pre: holds
  eff:
    atomic:
      message[(pid + 1) % numAgents] = true
      holds = false
Receive:
  pre: message[pid]
  eff:
    atomic:
      message[pid] = false
      holds = true
invariant Exclusive: forall i, j: i != j implies not (holds@i and holds@j)
invariant Alone: forall i, j: i != j and holds@i implies not message[j]
invariant OnlyOne: forall i, j: i != j and message[i] implies not message[j]
invariant Mine: forall i: message[i] implies not holds@i
"""


def test_a_token_is_sent_round_a_ring_of_any_size() -> None:
    names = {"Exclusive", "Alone", "OnlyOne", "Mine", "no fault"}
    assert proved(TOKEN) == names


def test_a_token_that_stays_is_two() -> None:
    text = TOKEN.replace("      holds = false\n", "      holds = holds\n")
    assert proved(text) == {"no fault"}
    assert "Exclusive" in broken(text, 2)


def test_a_message_that_is_not_taken_away_is_received_twice() -> None:
    text = TOKEN.replace("      message[pid] = false\n", "      message[pid] = message[pid]\n")
    assert proved(text) == {"no fault"}


#: A sensor that names any robot.
PICK = """\
using Pick:
  sensors:
    int to = 0
  environment:
    to = choose(0, numAgents - 1)
"""

RACE = f"""
{PICK}
allwrite:
  int[numAgents] x
  int[numAgents] y
assume: forall i: x[i] == 0 and y[i] == 0
Set:
  pre: 0 <= Pick.to and Pick.to < numAgents
  eff:
    x[Pick.to] = pid + 1
    y[pid] = pid + 1
invariant Somebody: forall i: 0 <= x[i] and x[i] <= numAgents
invariant Own: forall i: y[i] == 0 or y[i] == i + 1
invariant Never: forall i: x[i] == 0
invariant Swapped: forall i: x[i] == 0 or x[i] == i + 1
"""


@pytest.mark.slow
def test_what_robots_write_at_one_place_is_one_of_their_values() -> None:
    assert proved(RACE) == {"Somebody", "Own", "no fault"}
    assert broken(RACE, 2) == {"Never", "Swapped"}


def test_the_last_writer_of_an_element_is_one_that_wrote_it() -> None:
    text = """
allwrite:
  bool[numAgents] seen
allread:
  bool[] went = false
assume: forall i: not seen[i]
Go:
  eff:
    went[pid] = true
    seen[(pid + 1) % numAgents] = true
invariant Behind: forall i: went[i] implies seen[(i + 1) % numAgents]
invariant Ahead: forall i: seen[i] implies went[i]
"""
    assert proved(text) == {"Behind", "no fault"}
    assert broken(text, 2) == {"Ahead"}


def test_elements_have_last_writers_of_their_own() -> None:
    text = """
allwrite:
  bool[numAgents] y
allread:
  bool[] went = false
assume: forall i: not y[i]
Go:
  pre: not any(went)
  eff:
    went[pid] = true
    y[pid] = true
invariant Went: forall i: y[i] implies went[i]
invariant Only: forall i, j: i != j and y[i] implies not y[j]
"""
    assert proved(text) == {"Went", "no fault"}
    assert broken(text, 2) == {"Only"}


def test_only_fields_in_blocks_have_one_writer() -> None:
    text = f"""
def Cell:
  bool taken
  int by
{PICK}
allwrite:
  Cell[numAgents] cell
assume: forall i: not cell[i].taken and cell[i].by == 0
Take:
  pre: 0 <= Pick.to and Pick.to < numAgents and not cell[Pick.to].taken
  eff:
    cell[Pick.to].taken = true
    atomic:
      cell[Pick.to].by = pid
invariant Known: forall i: 0 <= cell[i].by and cell[i].by < numAgents
invariant Nobody: forall i: cell[i].by == 0
invariant First: forall i: not cell[i].taken implies cell[i].by == 0
"""
    assert proved(text) == {"Known", "First", "no fault"}
    assert "Nobody" in broken(text, 2)


def test_a_robot_that_writes_where_another_updates_loses_its_update() -> None:
    text = """
allwrite:
  int[numAgents] x
assume: forall i: x[i] == 0
Add:
  pre: x[WHERE] < 3
  eff:
    x[WHERE] = x[WHERE] + 1
"""
    own = text.replace("WHERE", "(pid + 1) % numAgents")
    assert proved(own) == {"no lost update of x", "no fault"}
    common = text.replace("WHERE", "0")
    assert proved(common) == {"no fault"}
    assert "no lost update of x" in seen(common, 2)[0]


# --- generated programs ---------------------------------------------------------------------------

INDICES = ("pid", "0", "numAgents - 1", "(pid + 1) % numAgents", "Pick.to", "at[pid]")
VALUES = ("1", "2", "x[pid]", "y[pid]", "x[Pick.to]", "at[pid] + 1")
GUARDS = ("true", "x[pid] == 0", "y[Pick.to] != 2", "x[pid] == y[pid]", "at[pid] == pid")
CLAIMS = (
    "forall i: 0 <= x[i] and x[i] <= 2",
    "forall i: x[i] == 0 or y[i] == 0",
    "forall i: x[i] == y[i]",
    "forall i: x[i] <= y[i]",
    "forall i: y[i] != 2",
    "forall i: y[i] == 0",
    "forall i, j: i != j implies x[i] == 0 or x[j] == 0",
    "forall i: x[i] == 1 implies at[i] == i",
    "forall i: x[i] != 0 implies exists j: at[j] == i",
    "x[0] != 1",
    "x[numAgents - 1] != 2",
)


def generated(seed: int) -> str:
    """A program whose robots write elements of two arrays, here and there, in blocks or not."""
    random = Random(seed)
    lines = [
        *PICK.splitlines(),
        "allwrite:",
        "  int[numAgents] x",
        "  int[numAgents] y",
        "allread:",
        f"  int[] at = {random.choice(('pid', '0'))}",
        "assume: forall i: x[i] == 0 and y[i] == 0",
    ]
    for event in range(random.randint(1, 3)):
        lines += [
            f"E{event}:",
            "  pre: 0 <= Pick.to and Pick.to < numAgents and 0 <= at[pid] and at[pid] < numAgents"
            f" and {random.choice(GUARDS)}",
            "  eff:",
        ]
        in_block = random.random() < 0.5
        lines += ["    atomic:"] * in_block
        for _ in range(random.randint(1, 2)):
            target = f"{random.choice('xxy')}[{random.choice(INDICES)}]"
            lines.append("  " * in_block + f"    {target} = {random.choice(VALUES)}")
        if random.random() < 0.4:
            lines.append(f"    at[pid] = {random.choice(('Pick.to', '(at[pid] + 1) % numAgents'))}")
    claims = random.sample(CLAIMS, 4)
    lines += [f"invariant C{number}: {claim}" for number, claim in enumerate(claims)]
    return "\n".join(lines) + "\n"


def seen(text: str, robots: int) -> tuple[set[str], bool]:
    """The claims that a search for so many robots sees broken, and whether it saw everything."""
    system = system_of(text, robots)
    stated = [claim.stated for claim in claims_of(system) if claim.stated is not None]
    limits = Limits(states=2_000 if robots < 3 else 600, rounds=5)
    found = survey(system, stated, limits, subjects=frozenset(GoalKind))
    return {name_of(v.claim) for v in found.violated}, isinstance(found.end, Exhausted)


def agreed(first: int, last: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in range(first, last):
        text = generated(seed)
        names = proved(text)
        count["programs"] += 1
        count["proved"] += len(names)
        for robots in (1, 2, 3):
            bad, everything = seen(text, robots)
            assert not bad & names, (seed, robots, bad & names)
            count["broken"] += len(bad)
            count["all runs seen"] += everything
    return count


@pytest.mark.slow
@pytest.mark.parametrize("last", sampled(3, [12]))
def test_what_is_proved_is_refuted_for_none(last: int) -> None:
    count = agreed(0, last)
    assert count["programs"] == last
    assert count["proved"] >= last
    assert count["broken"] >= last


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_many_generated_programs(block: int) -> None:
    agreed(12 + 30 * block, 42 + 30 * block)
