"""Claims that are judged in states: only those of which each mistake is one of a state."""

from __future__ import annotations

import pytest

from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.engines.bits.circuit import Circuit, circuit_of
from koord.verify.engines.bits.constraint_selection import whatever_range
from tests.loading import program_of


def judged_between(text: str, robots: int = 2) -> tuple[Circuit, set[str]]:
    """The circuit of a text, and the names of the claims that are judged in its states."""
    made = dealt(program_of(text), robots)
    circuit = circuit_of(made, claims_of(made))
    _, _, in_states = whatever_range(circuit, between=True)
    return circuit, {claim.name for claim in in_states}


GO = """
enum Place: home, road, field
local:
  Place at = home
allwrite:
  bool free = true
Leave:
  pre: at == home
  eff:
    atomic:
      if free:
        free = false
        at = road
Arrive:
  pre: at == road
  eff:
    atomic:
      free = true
      at = field
"""


@pytest.mark.parametrize(
    "claim",
    [
        "forall i, j: i != j implies not (at@i == road and at@j == road)",
        "forall i: ran(Leave)@i implies not free",
    ],
)
def test_what_variables_hold_and_what_ran_is_judged_in_states(claim: str) -> None:
    """[T-ROUND-ENDS]"""
    _, found = judged_between(f"{GO}invariant Claim: {claim}")
    assert found == {"Claim"}


STOPS = """
local:
  bool done = false
Do:
  pre: not done
  eff:
    done = true
    trystop
"""

PORTS = """
using Way:
  sensors:
    bool clear
  environment:
    clear = choose(0, 1) == 0
local:
  bool gone = false
Go:
  pre: Way.clear
  eff: gone = true
"""

ENDLESS = """
using Way:
  sensors:
    int s
  actuators:
    int least
  environment:
    s = choose(least, 1)
local:
  bool gone = false
init:
  Way.least = 0
Go:
  pre: not gone
  eff:
    gone = true
    Way.least = 2
"""


@pytest.mark.parametrize(
    ("text", "claim"),
    [
        # Who moved and asks to stop is seen so while others have not moved.
        (STOPS, "forall i: done@i implies stopped@i"),
        # Ways that were clear when robots went may be closed when the round ends, and open again.
        (PORTS, "forall i: gone@i implies Way.clear@i"),
        # No number is from 2 to 1: behind that round there is no configuration.
        (ENDLESS, "forall i: not gone@i"),
    ],
)
def test_what_rounds_break_on_their_way_is_judged_in_rounds(text: str, claim: str) -> None:
    circuit, found = judged_between(f"{text}\ninvariant Claim: {claim}")
    assert any(c.name == "Claim" and ways for c, ways in circuit.broken.items())
    assert "Claim" not in found
