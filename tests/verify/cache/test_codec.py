"""Structs as plain data: what is kept comes back, and nothing else does."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any

import pytest
from msgspec.structs import replace

from koord.syntax.core import Const
from koord.syntax.types import INT
from koord.verify.cache.codec import CodecError, plain, revived
from koord.verify.claims import NO_FAULT
from koord.verify.engine_names import Engine
from koord.verify.obstacles import Lengths
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.verify.asking import of_text

TEXT = """
local:
    int x = 0
    float y
Go:
    pre: x < 4
    eff: x = x + 1
assume: forall i: y@i >= 0.5
invariant Few: forall i: x@i < 2
invariant More: forall i: x@i <= 4
"""


def test_verdicts_come_back_as_they_were() -> None:
    """With the runs that break claims, and all that these read."""
    for verdict in verify(of_text(TEXT), Bounds(rounds=4)).verdicts:
        verdict = replace(verdict, claim=NO_FAULT)
        found = revived(json.loads(json.dumps(plain(verdict))))
        shown = verdict.counterexample
        if shown is not None:
            verdict = replace(verdict, counterexample=replace(shown, span=None))
        assert found == verdict


def test_exact_numbers_obstacles_and_lemmas_come_back() -> None:
    lemma = Const(Fraction(1, 3), INT)
    obstacles = (Lengths(Engine.BMC, ("lists",)),)
    verdict = Verdict(NO_FAULT, Outcome.HOLDS, Engine.BITS, 1.0, 7, obstacles=obstacles)
    assert revived(json.loads(json.dumps(plain((lemma, verdict))))) == (lemma, verdict)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"enum": ["engine_names.Engine", "NOBODY"]},
        {"enum": ["os.Nothing", "A"]},
        {"struct": "subprocess.Popen", "args": ["ls"]},
        {"struct": "core.Const"},
        {"struct": "core.Const", "value": 1, "type": 1, "more": 1},
        {"struct": ["core.Const"]},
        {"fraction": ["1", "0"]},
        {"fraction": ["x", "1"]},
    ],
    ids=str,
)
def test_nothing_is_made_of_other_data(data: Any) -> None:
    with pytest.raises(CodecError):
        revived(data)


def test_what_is_no_kept_struct_is_refused() -> None:
    for value in (object(), {1: 2}, of_text(TEXT)):
        with pytest.raises(CodecError):
            plain(value)
