"""What follows from known invariants is proved of no round; what does not follow is not."""

from __future__ import annotations

import pytest

from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.every_n.consequences import consequences
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import SPARING, Means
from koord.verify.instants import shadowed
from tests.loading import example_program, program_of

#: `Known` and `Ends` are taken for granted; no event keeps them.
TEXT = """
def fun near(int a, int b) -> bool: extern
    ensures: result == near(b, a)
local:
    int n = 0
    int m = 0
Go:
    pre: true
    eff:
        n = n + 1
        m = n
invariant Known: forall i: n@i < 4 and (forall j: near(n@i, n@j))
invariant Ends at round: forall i: m@i < 4
"""

KNOWN = {"Known", "Ends"}


def means() -> Means:
    return Means(Deadline(), Effort.of_seconds(2.0), SPARING, 0)


def following(stated: str, known: set[str] = KNOWN) -> bool:
    """Whether a statement follows from the known ones."""
    system = dealt(program_of(f"{TEXT}invariant New{stated}\n"), 3)
    claims = {claim.name: claim for claim in claims_of(system)}
    given = [claims[name] for name in sorted(known)]
    return claims["New"] in consequences(system, [claims["New"]], given, means())


@pytest.mark.parametrize(
    "stated",
    [
        ": forall i: n@i < 4",
        ": forall i: n@i < 5",
        ": forall i, j: near(n@j, n@i)",
        " at round: forall i: n@i + m@i < 8",
        ": forall i: n@i == 3 implies n@i > 2",
    ],
)
def test_what_is_said_in_other_words_or_is_less_follows(stated: str) -> None:
    assert following(stated)


@pytest.mark.parametrize(
    "stated",
    [
        ": forall i: n@i < 3",
        ": forall i: m@i < 4",  # known at the ends of rounds only
        ": forall i: n@i >= 0",
        ": forall i, j: near(n@i, m@j)",
        ": forall i: n@i < 4 and 5 % n@i < 9",  # a division by zero
        " at round: forall i: ran(Go)@i implies n@i < 4 and m@i < 3",
    ],
)
def test_what_is_more_does_not_follow(stated: str) -> None:
    assert not following(stated)


def test_nothing_follows_from_nothing() -> None:
    assert not following(": forall i: n@i < 5", known=set())


def test_what_is_known_is_assumed_of_each_round() -> None:
    text = """
local:
    int n = 0
    int m = 0
Go:
    pre: n < 3
    eff: m = n
Up:
    pre: n < 9
    eff: n = n + 1
invariant Known: forall i: n@i < 2
invariant New: forall i: m@i < 2
"""
    system = dealt(program_of(text), 2)
    known, new, _ = claims_of(system)
    budget = Deadline(), Effort.of_seconds(2.0), SPARING, 0
    assert new not in prove(system, [new], *budget).proved
    assert new in prove(system, [new], *budget, known=[known]).proved
    assert known not in prove(system, [new], *budget, known=[known]).proved


#: What is known is of one module; the other has a sensor that is called alike.
TWO_MODULES = """
using First:
  sensors:
    int x
  environment:
    x = 0
using Second:
  sensors:
    int x
  environment:
    x = 1
local:
    int n = 0
Go:
    pre: n < 3
    eff: n = n + 1
invariant Known: forall i: First.x@i == 0
invariant New: forall i: {}.x@i == 0
"""


@pytest.mark.parametrize(("module", "follows"), [("First", True), ("Second", False)])
def test_of_sensors_that_are_called_alike_one_is_known(module: str, follows: bool) -> None:
    system = dealt(program_of(TWO_MODULES.format(module)), 2)
    known, new, _ = claims_of(system)
    assert (consequences(system, [new], [known], means()) == {new}) is follows


def test_what_holds_at_the_ends_of_rounds_is_not_known_between_them() -> None:
    """Two robots meet in the middle of each round, where the shadows of their sensors are."""
    shadows = shadowed(dealt(example_program("broken/crossing"), 2), Deadline())
    claims = claims_of(shadows.system)
    between = [claim for claim in claims if claim.name in shadows.names]
    ends = [claim for claim in claims if claim.is_state_property and claim not in between]
    assert {"Apart between rounds"} <= {claim.name for claim in between}
    assert not consequences(shadows.system, between, ends, means())
