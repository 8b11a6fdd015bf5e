"""Every program in specs/examples gets the verdicts that expected.yaml says."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.loading import example_files

EXAMPLES = Path(__file__).parent.parent / "specs" / "examples"
EVERY_ROUND = "holds in every round"

#: How the runs that break something end, in the words of `koord replay`.
ENDS = ("breaks", "loses an update", "ends in a fault")

Scalar = int | float | bool | str


@dataclass(frozen=True)
class Run:
    """One configuration of one program, as expected.yaml has it."""

    exit: int
    robots: int | str | None = None
    rounds: int | None = None
    delta: Scalar | None = None
    set: dict[str, object] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)
    says: dict[str, str] = field(default_factory=dict)
    empty: list[str] = field(default_factory=list)
    slow: bool = False

    def command(self, file: str) -> list[str]:
        return ["verify", str(EXAMPLES / file), "--json", *self.chosen()]

    def chosen(self) -> list[str]:
        """The flags that say what is to be verified; none is what the program states."""
        words = list(self.flags)
        for flag in ("robots", "rounds", "delta"):
            given = getattr(self, flag)
            words += [] if given is None else [f"--{flag}", str(given)]
        for name, value in self.set.items():
            words += ["--set", f"{name}={json.dumps(value)}"]
        return words


@dataclass(frozen=True)
class Expected:
    """One program."""

    runs: list[Run]
    warnings: list[str]


def _expected() -> dict[str, Expected]:
    entries = yaml.safe_load((EXAMPLES / "expected.yaml").read_text(encoding="utf-8"))
    return {
        file: Expected([Run(**run) for run in entry["runs"]], entry.get("warnings", []))
        for file, entry in entries.items()
    }


EXPECTED = _expected()


def _cases() -> Iterator[object]:
    for file, entry in EXPECTED.items():
        for number, run in enumerate(entry.runs):
            marks = [pytest.mark.slow] if run.slow else []
            yield pytest.param(file, run, id=f"{file.removesuffix('.krd')}-{number}", marks=marks)


def test_every_program_is_expected_something_of() -> None:
    files = {path.relative_to(EXAMPLES).as_posix() for path in example_files()}
    assert set(EXPECTED) == files
    assert list(EXPECTED) == sorted(EXPECTED)


@pytest.mark.parametrize("file", EXPECTED)
def test_the_checker_warns_of_what_is_expected(file: str) -> None:
    path = EXAMPLES / file
    found = load(Source(file, path.read_text(encoding="utf-8")))
    assert [d.code for d in found.diagnostics] == EXPECTED[file].warnings
    assert found.program is not None


def test_every_program_is_laid_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fmt", "--check", *(str(EXAMPLES / file) for file in EXPECTED)]) == Exit.OK


@pytest.mark.parametrize(("file", "run"), list(_cases()))
def test_the_verdicts_are_those_expected(
    file: str, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept.json"
    code = main([*run.command(file), "--trace", str(kept)])
    (report,) = json.loads(capsys.readouterr().out)["reports"]
    claims = {claim["name"]: claim for claim in report["claims"]}
    assert set(run.says) <= set(claims)
    for name, claim in claims.items():
        wanted = run.says.get(name, EVERY_ROUND)
        assert _meets(claim, wanted), f"{name}: {_said(claim)}, expected: {wanted}"
    assert [_empty(v) for v in report["vacuities"]] == run.empty
    assert code == run.exit
    assert kept.exists() is (code == Exit.VIOLATED)
    if kept.exists():
        assert_is_read(kept, run, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["search", "bmc", "bits", "spacer", "induction"])
@pytest.mark.parametrize("file", [name for name in EXPECTED if name.startswith("broken/")])
def test_what_any_engine_finds_is_read(
    file: str, engine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the form of other tools as well, where they go on with it."""
    (run, *_) = [run for run in EXPECTED[file].runs if run.exit == Exit.VIOLATED]
    for kept in (tmp_path / "kept.json", tmp_path / "kept.itf.json"):
        command = [*run.command(file), "--engine", engine, "--property-timeout", "10"]
        main([*command, "--trace", str(kept)])
        capsys.readouterr()
        if kept.exists():
            assert_is_read(kept, run, capsys)


def assert_is_read(kept: Path, run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    """What was kept is legal, and breaks what it says. [REPLAY]"""
    assert main(["replay", str(kept)]) == Exit.OK
    said = capsys.readouterr().out
    # Of what breaks between the ends of rounds a trace has the run, and no claim.
    assert any(f"  it {how}" in said for how in ENDS) or "--instants" in run.flags, said


def _empty(vacuity: dict[str, object]) -> str:
    """What makes verdicts say less than they seem to, in the words of expected.yaml."""
    certain = "never" if vacuity["certain"] else "not in time"
    return f"{vacuity['what']} {vacuity['subject']} {certain}"


def _said(claim: dict[str, object]) -> str:
    """A verdict in the words of expected.yaml."""
    violated = claim["violated"]
    if isinstance(violated, dict) and violated["loop"] is not None:
        return f"violated by a loop of rounds {violated['loop']} to {violated['round']}"
    if isinstance(violated, dict):
        return f"violated in round {violated['round']}"
    if claim["outcome"] == "holds" and claim["all_rounds"]:
        return EVERY_ROUND
    return f"{claim['outcome']} through round {claim['through_round']}"


def _meets(claim: dict[str, object], wanted: str) -> bool:
    """Whether a verdict is the one wanted. A proof for all rounds is more than one for some."""
    said = _said(claim)
    return said == wanted or (said == EVERY_ROUND and wanted.startswith("holds through"))
