"""A solver that ends in the middle of a question takes nothing with it, and is told of."""

from __future__ import annotations

import os
import signal

import pytest

from koord.recheck import solving
from koord.recheck.checking import RecheckOutcome
from koord.recheck.solving import SolverAnswer, SolverEndedError, SolverSession
from tests.recheck.certificates import conjunct, document_of, rechecked, with_text

pytest.importorskip("cvc5")

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="mended solvers are forked")


@pytest.fixture
def crash(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Words at which the solver crashes."""
    words: list[str] = []
    told = solving._Solver.told

    def crashing(solver: solving._Solver, text: str) -> tuple[str, str]:
        if any(word in text for word in words):
            os.kill(os.getpid(), signal.SIGSEGV)
        return told(solver, text)

    monkeypatch.setattr(solving._Solver, "told", crashing)
    return words


def test_a_refutation_stands_whose_configuration_is_not_told(crash: list[str]) -> None:
    crash.append("(get-value")
    document = document_of("hvac.krd", 1)
    with_text(document, "temp <= 80", "temp <= 70")
    conjunct(document, "Comfort")["text"] = "invariant Comfort: 60 <= HVAC.temp and HVAC.temp <= 70"
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.REFUTED
    last = found.settled[-1]
    assert last.answer is SolverAnswer.SAT
    (told,) = last.state
    assert told.endswith("nor what comes after it: cvc5 crashed (SIGSEGV) when it was asked")


def test_obligations_that_are_not_settled_so_are_unknown(crash: list[str]) -> None:
    crash.append("(check-sat)")
    found = rechecked(document_of("hvac.krd", 1))
    assert found.outcome is RecheckOutcome.UNKNOWN
    assert found.reason == "initiation: cvc5 crashed (SIGSEGV)"
    assert [opinion.reason for opinion in found.opinions] == ["cvc5 crashed (SIGSEGV)"] * 4


def test_a_script_on_which_it_crashes_is_unknown(crash: list[str]) -> None:
    crash.append("(assert\n")  # as scripts in certificates are written, and no obligation is
    found = rechecked(document_of("hvac.krd", 1))
    assert found.here is not None
    assert found.here.outcome is RecheckOutcome.CONFIRMED
    assert found.outcome is RecheckOutcome.UNKNOWN
    assert found.reason == "the script 'initiation' in the certificate: cvc5 crashed (SIGSEGV)"


def test_a_session_that_is_over_says_so() -> None:
    with SolverSession.start() as session:
        assert session.check() is SolverAnswer.SAT
        session.close()
        with pytest.raises(SolverEndedError, match="cvc5 has ended"):
            session.check()
