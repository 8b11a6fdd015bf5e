"""``koord doctor`` tells what is there, what is missing, and how it is installed."""

from __future__ import annotations

import json
import shutil
import tomllib
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.api import doctor as looking
from koord.api.doctor import EXTRAS, NEEDED
from koord.cli.exits import Exit
from koord.cli.main import main

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

#: Extras for who works on koord itself.
OWN = {"dev", "docs", "fuzz"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "cache"))


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, Any]:
    code = main(["doctor", "--json", *words])
    document = json.loads(capsys.readouterr().out)
    Draft202012Validator(koord.schema("doctor")).validate(document)
    return code, document


def without(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    """Let packages be missing."""

    def version(name: str) -> str:
        if name in packages:
            raise PackageNotFoundError(name)
        return version_of(name)

    monkeypatch.setattr(looking, "version_of", version)


def named(requirement: str) -> str:
    """The name of the package that a requirement is about."""
    head = requirement.partition(";")[0]
    return min((head.partition(sign)[0].strip() for sign in "<>=[ "), key=len)


def test_it_knows_every_extra_with_its_packages() -> None:
    extras = {
        name: {named(one) for one in needs}
        for name, needs in PROJECT["optional-dependencies"].items()
    }
    assert {one.name: set(one.packages) for one in EXTRAS} == {
        name: packages for name, packages in extras.items() if name not in OWN
    }


def test_it_knows_every_package_that_koord_needs() -> None:
    assert set(NEEDED) == {named(one) for one in PROJECT["dependencies"]}


def test_all_is_there_where_koord_works(capsys: pytest.CaptureFixture[str]) -> None:
    code, document = told(capsys)
    assert (code, document["problems"]) == (Exit.OK, [])
    assert all(one["installed"] and one["trouble"] is None for one in document["needed"])
    assert document["koord"] == koord.__version__
    assert {one["name"] for one in document["drivers"]} >= {"sim", "mavlink"}


def test_what_is_missing_is_told_with_its_cure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "llvmlite", "mcap")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert main(["doctor"]) == Exit.OK
    shown = capsys.readouterr().out
    assert "missing: llvmlite" in shown
    assert "(pip install 'koord[fast]')" in shown
    assert "(apt-get install berkeley-abc)" in shown
    assert "all is there that koord needs" in shown
    _, document = told(capsys)
    sim = next(one for one in document["extras"] if one["name"] == "sim")
    assert not sim["installed"]
    assert [one["name"] for one in sim["packages"] if one["installed"] is None] == ["mcap"]


def test_what_is_wanted_has_to_be_there(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    assert told(capsys, "abc", "completion")[0] == Exit.OK
    without(monkeypatch, "shtab", "llvmlite")
    code, document = told(capsys, "abc", "completion")
    assert code == Exit.VIOLATED
    assert document["problems"] == [
        "completion is wanted and missing: pip install 'koord[completion]'"
    ]


def test_what_koord_needs_is_a_problem_where_it_is_missing_or_broken(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(name: str) -> object:
        if name == "z3":
            raise OSError("libz3.so: no such file")
        return object()

    monkeypatch.setattr(looking, "import_module", broken)
    without(monkeypatch, "lark")
    assert main(["doctor"]) == Exit.VIOLATED
    shown = capsys.readouterr().out
    assert (
        "problem: z3-solver cannot be loaded: OSError: libz3.so: no such file; remove it" in shown
    )
    monkeypatch.undo()


def test_a_package_that_is_not_there_is_no_package_that_cannot_be_loaded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(name: str) -> object:
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr(looking, "import_module", missing)
    without(monkeypatch, *NEEDED)
    problems = koord.doctor().problems
    assert problems == tuple(f"{name} is not installed: pip install {name}" for name in NEEDED)


def test_a_cache_that_cannot_be_written_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "file" / "cache"))
    (problem,) = koord.doctor().problems
    assert "cannot be written: KOORD_CACHE names another folder" in problem


def test_nothing_is_changed(tmp_path: Path) -> None:
    found = koord.doctor()
    assert found.cache.folder == str(tmp_path / "cache")
    assert found.cache.is_writable
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_there_is_not_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "quick"]) == Exit.BAD_INPUT
    assert "there is no 'quick'; there are cluster, " in capsys.readouterr().err


def test_a_notebook_shows_what_is_missing() -> None:
    found = koord.doctor()
    shown = found._repr_html_()
    assert "fast" in shown
    assert repr(found).startswith(f"<Doctor koord {koord.__version__}")
