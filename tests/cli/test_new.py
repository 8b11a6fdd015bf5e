"""``koord new`` makes a program that passes all that it comes with, and replaces nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

import koord
from koord.cli.exits import Exit
from koord.cli.main import main


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_is_made_passes_every_command(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "my_posts2"]) == Exit.OK
    assert "koord verify my_posts2.krd --with properties.krd" in capsys.readouterr().out
    monkeypatch.chdir(folder / "my_posts2")
    properties = ["--with", "properties.krd"]
    assert main(["check", "--strict", "my_posts2.krd", *properties]) == Exit.OK
    assert main(["fmt", "--check", "my_posts2.krd", "properties.krd"]) == Exit.OK
    assert main(["config", "check", "my_posts2.yaml"]) == Exit.OK
    assert main(["verify", "my_posts2.krd", *properties, "--jobs", "1"]) == Exit.OK
    assert "Served" in capsys.readouterr().out
    pytest.importorskip("ompl")
    assert main(["sim", "my_posts2.krd", *properties, "--no-html"]) == Exit.OK


def test_its_own_tests_pass(pytester: pytest.Pytester, folder: Path) -> None:
    made = koord.new(folder / "posts")
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", str(folder / made.folder))
    result.assert_outcomes(passed=4)


def test_its_verdict_can_be_lost(folder: Path) -> None:
    """The properties are about the program: who takes a post without counting is found out."""
    koord.new("posts")
    path = Path("posts/posts.krd")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("post = taken\n", "post = 0\n"), encoding="utf-8")
    report = koord.verify(koord.load(path), robots=2, rounds=4)
    assert not report.verdict("Exclusive").holds


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("Posts", "posts"),
        ("my posts", "my_posts"),
        ("1posts", "my_robots"),
        ("pösts", "p_sts"),
        ("a" * 41, "a" * 40),
        ("con", "my_con"),
        ("properties", "my_properties"),
        (".", "my_robots"),
        ("..", "my_robots"),
        ("x/@name@", "name"),
        ("", "my_robots"),
    ],
)
def test_what_is_no_name_is_refused_with_one_that_is(
    name: str, near: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", name]) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert f"write {near}\n" in said
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("kind", ["file", "folder", "link", "rosbag"])
def test_nothing_is_replaced(kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = folder / "posts"
    if kind == "file":
        there.write_text("mine")
    elif kind == "link":
        there.symlink_to("nowhere")
    else:
        there.mkdir()
        if kind == "rosbag":  # which those who write one replace
            (there / "metadata.yaml").write_text("mine")
    before = sorted(folder.rglob("*"))
    assert main(["new", "posts"]) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert "posts: error K903: cannot be written: it is there already" in said
    assert "choose another name" in said
    assert sorted(folder.rglob("*")) == before


def test_where_there_is_no_folder_nothing_is_made(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "no/such/posts"]) == Exit.BAD_INPUT
    assert "there is no folder" in capsys.readouterr().err
    assert list(folder.iterdir()) == []


def test_the_api_says_what_it_made(folder: Path) -> None:
    made = koord.new(folder / "posts")
    assert made.name == "posts"
    assert made.to_dict() == {"folder": str(folder / "posts"), "files": list(made.files)}
    assert {path.name for path in (folder / "posts").iterdir()} == set(made.files)
    assert "@" not in "".join(path.name for path in folder.rglob("*"))
    assert not any("@name@" in path.read_text() for path in (folder / "posts").iterdir())
