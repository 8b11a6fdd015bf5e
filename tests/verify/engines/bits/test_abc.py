"""abc's PDR in the place of IC3: its invariants are asked again, its violations replayed."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import abc
from koord.verify.engines.bits.ic3 import ClauseInvariant
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.verify.asking import of_text

needs_abc = pytest.mark.skipif(
    abc.installed() is None, reason="abc is not installed (Debian: apt-get install berkeley-abc)"
)

#: Nobody is at 9 or above: that is not inductive, since from 8 one would come to 10.
STEPS = """
allwrite:
  int x = 0
Up:
  pre: x < 6
  eff: atomic: x = x + 2
Leap:
  pre: x == 8
  eff: atomic: x = 10
invariant Low: x < 9
invariant Even: x != 4
"""


def asked(rounds: int = 2) -> dict[str, Verdict]:
    report = verify(of_text(STEPS), Bounds(rounds, 60), Engine.ABC)
    return {verdict.claim.name: verdict for verdict in report.verdicts}


@needs_abc
def test_what_is_not_inductive_is_proved_and_what_breaks_is_found() -> None:
    found = asked()
    assert (found["Low"].outcome, found["Low"].engine) == (Outcome.HOLDS, Engine.ABC)
    assert found["Low"].rounds is None
    shown = found["Even"].counterexample
    assert shown is not None
    assert shown.round == 2


#: From 10 on nobody comes to 3, from which one would come to 1. That is not inductive either.
DOWN = """
allwrite:
  int x = 10
Down:
  pre: x > 4
  eff: atomic: x = x - 2
Leap:
  pre: x == 3
  eff: atomic: x = 1
invariant High: x > 1
"""


@needs_abc
def test_invariants_are_those_of_latches_that_start_true() -> None:
    """abc negates these, and tells invariants of what it made of them."""
    found, _ = verify(of_text(DOWN), Bounds(2, 60), Engine.ABC).verdicts
    assert (found.outcome, found.engine, found.rounds) == (Outcome.HOLDS, Engine.ABC, None)


@needs_abc
def test_rounds_behind_the_bound_are_found() -> None:
    shown = asked(rounds=1)["Even"].counterexample
    assert shown is not None
    assert shown.round == 2


def test_no_invariant_is_taken_on_trust(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(abc, "searched", lambda *_: ClauseInvariant((), 0))
    assert asked()["Low"].outcome is not Outcome.HOLDS or asked()["Low"].rounds is not None


def test_who_has_no_abc_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "steps.krd"
    path.write_text(STEPS, encoding="utf-8")
    monkeypatch.setattr(abc, "installed", lambda: None)
    assert frame.main(["verify", str(path), "--engine", "abc"]) == Exit.BAD_INPUT
    cure = "(Debian: apt-get install berkeley-abc); --engine bits needs none\n"
    assert f"error: --engine abc is not here {cure}" in capsys.readouterr().err
