"""Certificates of what was proved on slices: they are rechecked against the whole text. [T-CONE]"""

from __future__ import annotations

import pytest

from koord.recheck.checking import RecheckOutcome
from koord.verify.engine_names import Engine
from tests.recheck.test_found import made, outcome
from tests.sampling import first

pytest.importorskip("cvc5")

#: Robots take turns; nobody reads where they are, and how often they went counts for nothing.
TURNS = """
using Body:
    sensors:
        pos where
local:
    int mine = 0
    int count = 0
allwrite:
    int turn = 0
Go:
    pre: turn == pid and mine == 0
    eff:
        mine = 1
        count = count + 1
Leave:
    pre: mine == 1
    eff:
        mine = 0
        atomic: turn = 1 - turn
Count:
    pre: true
    eff: count = count + 2
invariant One: forall i, j: i == j or mine@i == 0 or mine@j == 0
"""


@pytest.mark.parametrize("choice", first(1, [Engine.BITS, None]))
def test_what_a_slice_proves_is_confirmed_of_the_whole_program(choice: Engine | None) -> None:
    document = made(TURNS, (0, 0), choice)
    texts = [conjunct["text"] for conjunct in document["invariant"]]
    assert "count = count + 2" in document["program"]["text"]
    assert len(texts) > 1
    assert not [text for text in texts if "count" in text or "where" in text]
    assert outcome(document) is RecheckOutcome.CONFIRMED
