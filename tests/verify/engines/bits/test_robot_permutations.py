"""Images of cubes when robots change places, and ways to be bad that are looked at one by one."""

from __future__ import annotations

from itertools import pairwise

import pytest

from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.engines.bits import ic3
from koord.verify.engines.bits.circuit import circuit_of
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.robot_permutations import images
from tests.loading import program_of

#: Who has taken a place, if somebody has: -1 and robots' numbers.
TAKEN = """\
local:
    bool has = false

allwrite:
    int[2] owner

init:
    for i = 0, 2:
        owner[i] = -1

Take:
    pre: not has
    eff:
        atomic:
            if owner[0] == -1:
                owner[0] = pid
                has = true

invariant Owned: forall i: has@i implies owner[0] == i
"""


def test_bits_that_are_the_same_in_all_robots_numbers_have_images() -> None:
    system = dealt(program_of(TAKEN), 3)
    claims = [claim for claim in claims_of(system) if claim.stated is not None]
    latches = circuit_of(system, claims).latches
    properties = tuple(claim.stated for claim in claims if claim.stated is not None)
    numbers = {latch.name: k for k, latch in enumerate(latches, start=1)}
    of = images(system, properties, latches)
    nobody, first, second = (numbers[f"owner.0.{bit}"] for bit in (2, 0, 1))
    has = [numbers[f"has@{i}"] for i in range(3)]
    assert of((nobody, has[0])) == [tuple(sorted((nobody, has[i]))) for i in (1, 2)]
    # These tell robots apart: what they are renamed to is no cube.
    assert of((first, has[0])) is None
    assert of((second, has[0])) is None


@pytest.mark.parametrize("most", [1, 2, 400])
def test_ways_to_be_bad_are_all_there_are(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ic3, "MOST_WAYS", most)
    g = Graph()
    inputs = [g.input(name) for name in "abcde"]
    pairs = [g.both(x, y) for x, y in pairwise(inputs)]
    ways = ic3._ways(g, g.any_of(pairs))
    assert len(ways) <= most
    nodes = [x >> 1 for x in inputs]
    for number in range(2 ** len(inputs)):
        values = {node: bool(number >> k & 1) for k, node in enumerate(nodes)}
        assert any(g.values(ways, values)) == any(g.values(pairs, values))
