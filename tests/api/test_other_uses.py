"""Rechecking, compiling, exporting, laying out and explaining from Python."""

from __future__ import annotations

import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.recheck import solving
from koord.recheck.checking import RecheckOutcome
from tests.children import forked_children

COUNTER = koord.Source(
    "counter.krd",
    """\
local:
  int x = 0
Up:
  pre: x < 3
  eff: x = x + 1
invariant Low: forall i: x@i >= 0
""",
)


@pytest.fixture(scope="module")
def certificate() -> koord.Certificate:
    made = koord.certify(koord.verify(COUNTER, robots=1, engine="induction"))
    assert made is not None
    return made


def test_a_certificate_is_confirmed(certificate: koord.Certificate, tmp_path: Path) -> None:
    heard: list[koord.Progress] = []
    report = koord.recheck(certificate, program=COUNTER, progress=heard.append)
    assert report.confirmed
    assert (report.reason, report.vacuous) == ("", ())
    assert heard
    assert "confirmed" in repr(report)
    assert "<td>Low</td>" in report._repr_html_()
    document = json.loads(report.to_json())
    Draft202012Validator(koord.schema("recheck")).validate(document)
    certificate.save(tmp_path / "c.json")
    assert koord.recheck(tmp_path / "c.json").outcome is RecheckOutcome.CONFIRMED


def test_threads_recheck_while_others_verify(certificate: koord.Certificate) -> None:
    with ThreadPoolExecutor(3) as pool:
        opinions = [pool.submit(koord.recheck, certificate) for _ in range(2)]
        report = pool.submit(koord.verify, COUNTER, robots=1, rounds=3, engine="bmc")
        assert [opinion.result().confirmed for opinion in opinions] == [True, True]
        assert report.result().verdict("Low").holds


def test_a_certificate_is_refused(certificate: koord.Certificate) -> None:
    other = koord.Source("other.krd", COUNTER.text.replace("3", "4"))
    with pytest.raises(koord.KoordError, match="K941"):
        koord.recheck(certificate, program=other)
    stop = koord.Cancellation()
    stop.cancel()
    with pytest.raises(koord.CancelledError):
        koord.recheck(certificate, cancellation=stop)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="mended solvers are forked")
def test_a_solver_at_work_is_ended_with_the_call(
    certificate: koord.Certificate, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = solving._Solver.told

    def lasting(solver: solving._Solver, text: str) -> tuple[str, str]:
        if "(check-sat)" in text:
            time.sleep(60.0)
        return told(solver, text)

    monkeypatch.setattr(solving._Solver, "told", lasting)
    stop = koord.Cancellation()
    timer = threading.Timer(0.5, stop.cancel)
    timer.start()
    began = time.monotonic()
    with pytest.raises(koord.CancelledError):
        koord.recheck(certificate, cancellation=stop)
    assert time.monotonic() - began < 30.0
    timer.join()
    assert forked_children() == set()


def test_a_program_is_compiled(tmp_path: Path) -> None:
    made = koord.compile(COUNTER)
    assert "class " in made.text
    assert made.to_dict() == {"program": "counter.krd", "text": made.text}
    made.save(tmp_path / "counter.py")
    assert (tmp_path / "counter.py").read_text() == made.text
    assert repr(made).startswith("<CompiledProgram counter.krd: ")


def test_claims_are_written_for_other_tools(tmp_path: Path) -> None:
    heard: list[koord.Progress] = []
    made = koord.export(COUNTER, "smt2", robots=1, rounds=2, progress=heard.append)
    assert b"(check-sat)" in made.content
    assert made.to_dict()["form"] == "smt2"
    module = koord.export(COUNTER, "tla", robots=1, module="Counter")
    assert b"MODULE Counter" in module.content
    assert any("no fault" in note or "TLC" in note for note in module.notes) or not module.notes
    module.save(tmp_path / "Counter.tla")
    assert (tmp_path / "Counter.tla").read_bytes() == module.content
    with pytest.raises(koord.ArgumentError, match="there is no 'pdf'"):
        koord.export(COUNTER, "pdf")
    with pytest.raises(koord.ArgumentError, match="is no name"):
        koord.export(COUNTER, "tla", module="A-B")
    with pytest.raises(koord.ArgumentError, match="there is no 'High'"):
        koord.export(COUNTER, "vmt", properties=["High"])
    with pytest.raises(TimeoutError):
        koord.export(COUNTER, "smt2", robots=3, rounds=50, timeout_s=1e-6)


def test_a_text_is_laid_out() -> None:
    assert koord.format(koord.Source("a.krd", "local:\n int x=0\n")) == "local:\n    int x = 0\n"
    with pytest.raises(koord.KoordError, match=r"a\.krd:1:"):
        koord.format(koord.Source("a.krd", "local\n"))


def test_a_code_is_explained() -> None:
    assert koord.explain("k905").title == "an argument does not fit"
    assert "K201" in koord.codes()
    with pytest.raises(koord.ArgumentError, match="there is no code 'K2011'; there are"):
        koord.explain("K2011")
