"""The protocols of specs/examples/protocols are safe, and their variants break what they are to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

import koord
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.verify.verdicts import Outcome
from tests.loading import PROTOCOLS

#: So many rounds stand for all of them where there are infinitely many configurations.
ROUNDS = 6

#: How long a search of all configurations may take; then bounded verdicts are compared.
PATIENCE_S = 120.0


@dataclass(frozen=True)
class Unsafe:
    """What is expected of a variant."""

    breaks: list[str]
    robots: int | None = None


@dataclass(frozen=True)
class Protocol:
    """A protocol, as expected.yaml has it."""

    published: list[str]
    robots: list[int]
    unsafe: dict[str, Unsafe]
    set: dict[str, int] = field(default_factory=dict)
    endless: bool = False

    def asked(self, path: Path, robots: int, engine: str) -> koord.VerifyReport:
        """What an engine says of a program for so many robots."""
        program = koord.load(path, params=self.set)
        return koord.verify(
            program, robots=robots, rounds=ROUNDS, engine=engine, jobs=1, timeout_s=PATIENCE_S
        )

    @property
    def judge(self) -> str:
        """The engine that goes through all runs, or through those of some rounds."""
        return "bmc" if self.endless else "search"


def _expected() -> dict[str, Protocol]:
    entries = yaml.safe_load((PROTOCOLS / "expected.yaml").read_text(encoding="utf-8"))
    found = {}
    for name, entry in entries.items():
        unsafe = {each: Unsafe(**said) for each, said in entry.pop("unsafe").items()}
        found[name] = Protocol(unsafe=unsafe, **entry)
    return found


EXPECTED = _expected()
UNSAFE = {each: name for name, protocol in EXPECTED.items() for each in protocol.unsafe}


def test_every_protocol_has_a_variant_that_is_unsafe() -> None:
    assert {path.stem for path in PROTOCOLS.glob("*.krd")} == set(EXPECTED)
    assert {path.stem for path in PROTOCOLS.glob("broken/*.krd")} == set(UNSAFE)
    assert all(protocol.unsafe for protocol in EXPECTED.values())
    assert list(EXPECTED) == sorted(EXPECTED)


def test_the_checker_warns_of_nothing() -> None:
    for path in PROTOCOLS.rglob("*.krd"):
        found = load(Source(path.name, path.read_text(encoding="utf-8")))
        assert (path.name, found.diagnostics) == (path.name, ())


def test_every_protocol_is_laid_out(capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(path) for path in PROTOCOLS.rglob("*.krd")]
    assert main(["fmt", "--check", *files]) == Exit.OK


def sizes() -> Iterator[object]:
    """Each protocol with each number of robots that is looked at."""
    for name, protocol in EXPECTED.items():
        for at, robots in enumerate(protocol.robots):
            marks = [pytest.mark.slow] if at else []
            yield pytest.param(name, robots, id=f"{name}-{robots}", marks=marks)


def violated(report: koord.VerifyReport) -> set[str]:
    """The names of the claims that are."""
    return {each.name for each in report.verdicts if each.outcome is Outcome.VIOLATED}


@pytest.mark.parametrize(("name", "robots"), list(sizes()))
def test_a_protocol_is_safe(name: str, robots: int) -> None:
    """In all configurations that there are, or in all runs of some rounds."""
    protocol = EXPECTED[name]
    report = protocol.asked(PROTOCOLS / f"{name}.krd", robots, protocol.judge)
    assert violated(report) == set()
    if robots == protocol.robots[0]:
        for verdict in report.verdicts:
            assert verdict.rounds is None or verdict.rounds >= ROUNDS, verdict


@pytest.mark.parametrize("variant", UNSAFE)
def test_a_variant_breaks_what_it_is_to_break(variant: str) -> None:
    """And nothing else; the run that does is one by the rules. [REPLAY]"""
    protocol = EXPECTED[UNSAFE[variant]]
    unsafe = protocol.unsafe[variant]
    robots = unsafe.robots or protocol.robots[0]
    report = protocol.asked(PROTOCOLS / "broken" / f"{variant}.krd", robots, protocol.judge)
    assert violated(report) == set(unsafe.breaks)
    for name in unsafe.breaks:
        trace = report.verdict(name).counterexample
        assert trace is not None
        assert trace.violation is not None
        assert trace.violation.name == name
        assert koord.replay(trace).legal


@pytest.mark.slow
@pytest.mark.parametrize(("name", "robots"), list(sizes()))
def test_nobody_contradicts_the_search(name: str, robots: int) -> None:
    """What is said by default is what a search says, of the protocol and of its variants."""
    protocol = EXPECTED[name]
    files = [PROTOCOLS / f"{name}.krd"]
    files += [PROTOCOLS / "broken" / f"{variant}.krd" for variant in protocol.unsafe]
    for path in files:
        judged = protocol.asked(path, robots, protocol.judge)
        said = protocol.asked(path, robots, "auto")
        for one, other in zip(judged.verdicts, said.verdicts, strict=True):
            assert one.name == other.name
            outcomes = {one.outcome, other.outcome}
            if Outcome.VIOLATED in outcomes:
                assert Outcome.HOLDS not in outcomes, f"{path.stem}: {one}, {other}"
