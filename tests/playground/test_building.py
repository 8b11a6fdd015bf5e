"""The playground as a static page: what it is made of, without building all of it."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path

import pytest

from koord.syntax import vocabulary
from playground import __main__ as building
from tests.api.test_story_page import data_of


@pytest.fixture(scope="module")
def page() -> str:
    return building.page()


def test_every_word_of_the_language_has_a_colour() -> None:
    known = {word for words in building.words().values() for word in words}
    wanted = (
        vocabulary.KEYWORDS
        | vocabulary.TYPES
        | vocabulary.GENERIC_TYPES
        | vocabulary.OWN_NAMES
        | vocabulary.FUNCTIONS
        | vocabulary.CONTEXTUAL
    )
    assert wanted <= known


def test_examples_are_the_programs_of_the_specification(page: str) -> None:
    examples = data_of(page)["examples"]
    assert examples[0]["name"] == "task"
    names = {one["name"]: one["text"] for one in examples}
    for path in building.EXAMPLES.glob("broken/*.krd"):
        assert names[path.stem] == path.read_text("utf-8")


def test_only_the_scripts_of_koord_may_run(page: str) -> None:
    """That of the page, and that of the stories that it shows in a frame."""
    from koord.api.story_page import page_of

    said = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert said is not None
    policy = dict(part.split(None, 1) for part in said[1].split("; "))
    assert policy["default-src"] == "'none'"
    assert "unsafe" not in policy["script-src"]
    for one in (page, page_of("another", [])):
        script = one.rpartition("<script>")[2].partition("</script>")[0]
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy["script-src"]


def test_the_page_names_no_other_place(page: str) -> None:
    shown = page.partition('<script type="application/json"')
    script = shown[2].partition("</script>")[2]
    assert "//" not in re.sub(r"^\s*//.*$|(?<=[;,{}]) // .*$", "", script, flags=re.M).replace(
        r"\/\/", ""
    )
    assert re.findall(r'(?:src|href)="([^"#]+)', shown[0]) == [
        "data:,",
    ]


def test_what_comes_from_registries_is_pinned_with_hashes() -> None:
    lines = (building.FOLDER / "wheels.txt").read_text("utf-8").splitlines()
    packages = [line for line in lines if not line.startswith("#")]
    assert len(dict(building._pinned())) == len(packages) == 4
    lock = json.loads((building.FOLDER / "package-lock.json").read_text("utf-8"))
    said = [one for name, one in lock["packages"].items() if name]
    assert all(one["integrity"].startswith("sha512-") for one in said)
    named = json.loads((building.FOLDER / "package.json").read_text("utf-8"))
    exact = lock["packages"]["node_modules/pyodide"]["version"]
    assert named["devDependencies"] == {"pyodide": exact}


def test_browsers_load_what_the_public_api_is_made_of() -> None:
    names = {name for name, _ in building.sources()}
    for wanted in (
        "koord/__init__.py",
        "koord/syntax/parsing/grammar.lark",
        "koord/api/page/page.html",
        "koord/sim/page/theme.css",
        "playground/answering.py",
    ):
        assert wanted in names
    assert not any(name.startswith("koord/cli/") for name in names)


def test_what_is_not_here_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in building.PYODIDE:
        (tmp_path / name).touch()
    monkeypatch.setattr(building, "modules", lambda: tmp_path)
    monkeypatch.setattr(building, "wheels", lambda folder: [])
    assert building.main([str(tmp_path / "page")]) == 1
    assert "node is not installed" in capsys.readouterr().err
