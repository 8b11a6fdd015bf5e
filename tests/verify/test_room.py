"""Maps in formulas have no more room than they have keys. [E-MAP] [T-COMMIT]"""

from __future__ import annotations

from itertools import islice

import pytest

from koord.semantics.storage import Cell, Storage
from koord.semantics.values import MOST_ROOM, Table
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted
from koord.verify.engines.explicit.search import survey
from koord.verify.verdicts import Outcome
from tests.sampling import but_slow
from tests.verify.asking import ask, bounded, inductive, of_text

#: In each turn a robot goes through a map three times, and writes where it is.
TURNING = """
enum Colour: red, green
allwrite:
  Map<{key}, int> m = {{{some}: 0}}
local:
  Map<{key}, int> own = {{}}
  int n = 0
Turn:
  pre: n < 2
  eff:
    atomic:
      for again = 0, 3:
        for k, v in m:
          m[{first}] = n
          m[{second}] = n
      own = m
    n = n + 1
invariant Two: length(m) <= 2
invariant Late: contains(m, {second}) implies m[{second}] < 1
"""

KEYS = [("bool", "true", "n < 9", "n < 2"), ("Colour", "red", "red", "green")]


def room(storage: Storage[Term]) -> int:
    assert isinstance(storage, Cell)
    assert isinstance(storage.value, Table)
    return len(storage.value.entries)


@pytest.mark.parametrize(("key", "some", "first", "second"), KEYS)
def test_maps_keep_to_the_number_of_their_keys(
    key: str, some: str, first: str, second: str
) -> None:
    """However often they are written, though nobody knows which robot writes, or where."""
    of = of_text(TURNING.format(key=key, some=some, first=first, second=second))
    for moment in islice(Unrolling(of).moments(), 1, 12):
        configuration = moment.configuration
        assert room(configuration.store.allwrite[0]) <= 2
        assert all(room(robot.locals[0]) <= 2 for robot in configuration.robots)


@pytest.mark.parametrize(("key", "some", "first", "second"), but_slow(["Colour"], KEYS))
def test_nothing_else_changes(key: str, some: str, first: str, second: str) -> None:
    of = of_text(TURNING.format(key=key, some=some, first=first, second=second))
    found = survey(of, of.program.properties, Limits(rounds=9))
    assert isinstance(found.end, Exhausted)
    first_broken = {v.claim.name: v.rounds for v in found.violated}
    assert first_broken.keys() == {"Late"}
    assert bounded(of, rounds=5).rounds == first_broken


def test_maps_of_few_keys_are_known_whole() -> None:
    """Induction starts from any map that there is, so its proofs need no bound."""
    text = """
enum Colour: red, green, blue, white
allwrite:
  Map<Colour, int> m = {}
local:
  Colour c = red
Paint:
  pre: not contains(m, c)
  eff:
    atomic:
      m[c] = 1
      c = white
Blot:
  pre: contains(m, white)
  eff:
    atomic:
      for k, v in m: m[k] = v
      m[blue] = 1
invariant One: (contains(m, blue) implies m[blue] == 1) and (contains(m, red) implies m[red] == 1)
invariant Four: length(m) <= 4
invariant Three: length(m) <= 3
"""
    of = of_text(text)
    proved, _ = inductive(of)
    assert {"One", "Four"} <= proved
    found = survey(of, of.program.properties, Limits(rounds=8))
    assert not {v.claim.name for v in found.violated} & proved


#: In each trip of the outer loop the list may become twice as long.
DOUBLING = """
local:
  bool[] xs = [true]
Grow:
  eff:
    for x in xs:
      for k = 0, length(xs):
        if x:
          append(xs, false)
invariant Some: length(xs) > 0
"""


@pytest.mark.slow
def test_lists_that_double_are_given_up() -> None:
    """Without a limit the circuit of one round would take all memory."""
    system = of_text(DOUBLING, robots=1)
    asked = ask(system, rounds=12, choice=Engine.BITS)
    verdict = asked["Some"]
    assert (verdict.outcome, verdict.rounds) == (Outcome.UNKNOWN, None)
    assert "lists grow beyond what is followed" in verdict.reason
    # Nothing here can fault, however long the list is. [T-CONE]
    assert asked.outcome("no fault") is Outcome.HOLDS
    some = ask(system, rounds=12, choice=Engine.BMC, seconds=600.0)["Some"]
    assert some.outcome is Outcome.UNKNOWN
    assert f"more than {MOST_ROOM} elements" in some.reason
    assert some.rounds == 8
