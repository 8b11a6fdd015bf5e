"""What `koord sim` keeps of a run, and what it says where that cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.api.files import write_folder
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.diagnostics import KoordError
from tests.sim.unpacking import data_of, unpacked

TASK = Path(__file__).resolve().parents[2] / "specs" / "examples" / "lineform.krd"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sim(*words: str) -> int:
    return main(["sim", str(TASK), "--time", "0.5", *words])


def test_a_run_leaves_a_page(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sim() == Exit.OK
    assert capsys.readouterr().out.splitlines()[-1] == "kept: run.html"
    page = unpacked(data_of((here / "run.html").read_bytes()))
    assert page.times_s[-1] == pytest.approx(0.5)
    assert page.document["ending"] == "the time was up"


def test_no_page_where_none_is_wanted(here: Path) -> None:
    assert sim("--no-html") == Exit.OK
    assert list(here.iterdir()) == []


def test_every_form_is_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for library in ("mcap", "matplotlib", "rosbags"):
        pytest.importorskip(library)
    words = ["--html", "a.html", "--record", "a.mcap", "--record", "a.rosbag2", "--plot", "a.svg"]
    for _ in range(2):  # what is there is replaced
        assert sim(*words) == Exit.OK
    kept = capsys.readouterr().out.splitlines()[-1]
    assert kept == "kept: a.html, a.mcap, a.rosbag2, a.svg"
    assert (here / "a.mcap").read_bytes().startswith(b"\x89MCAP")
    assert (here / "a.svg").read_bytes().startswith(b"<?xml")
    assert (here / "a.rosbag2" / "metadata.yaml").is_file()
    assert sorted(path.name for path in here.iterdir()) == [
        "a.html",
        "a.mcap",
        "a.rosbag2",
        "a.svg",
    ]


def test_the_page_can_be_in_space(here: Path) -> None:
    pytest.importorskip("viser")
    assert sim("--view", "3d") == Exit.OK
    assert b"__VISER_EMBED_DATA__" in (here / "run.html").read_bytes()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--record", "a.csv"], "'a.csv' ends in none of .mcap, .rrd, .rosbag2"),
        (["--plot", "a.gif"], "'a.gif' ends in none of .png, .svg, .pdf"),
        (["--html", "nowhere/a.html"], "there is no folder"),
        (["--record", "nowhere/a.rosbag2"], "there is no folder"),
        (["--html", "."], "it is a folder"),
        (["--pace", "0"], "'0' is not more than 0"),
        (["--view", "4d"], "invalid choice"),
    ],
)
def test_what_cannot_be_kept_is_told_before_the_run(
    here: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sim(*words) == Exit.BAD_INPUT
    told = capsys.readouterr()
    assert said in told.err
    assert told.out == ""
    assert list(here.iterdir()) == []


def test_what_is_no_recording_is_not_replaced(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    precious = here / "a.rosbag2" / "precious"
    precious.parent.mkdir()
    precious.write_text("mine")
    assert sim("--no-html", "--record", "a.rosbag2") == Exit.BAD_INPUT
    assert "something else is there" in capsys.readouterr().err
    assert precious.read_text() == "mine"


def test_a_folder_is_there_as_a_whole_or_not_at_all(here: Path) -> None:
    with pytest.raises(KoordError):
        write_folder("a.rosbag2", {"metadata.yaml": b"x", "no/such": b"y"})
    assert list(here.iterdir()) == []
    write_folder("a.rosbag2", {"metadata.yaml": b"x", "old": b"y"})
    write_folder("a.rosbag2", {"metadata.yaml": b"z"})
    assert [path.name for path in (here / "a.rosbag2").iterdir()] == ["metadata.yaml"]


def test_a_live_run_says_where_and_keeps_its_pace(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sim("--live", "--pace", "50") == Exit.OK
    said = capsys.readouterr().err
    assert said.startswith("live: http://127.0.0.1:")
    assert (here / "run.html").is_file()
