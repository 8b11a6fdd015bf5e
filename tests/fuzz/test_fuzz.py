"""What fuzzing found stays mended, and a few hundred variations in every run of the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from tests.fuzz import driving, texts, traces
from tests.sampling import first

FOUND = Path(__file__).parent / "found"

Write = Callable[[Path], None]


@pytest.mark.parametrize("path", sorted(FOUND.glob("*.krd")), ids=lambda path: path.stem)
def test_texts_that_were_found(path: Path) -> None:
    texts.examine(path.read_bytes())


@pytest.mark.parametrize("path", sorted(FOUND.glob("*.json")), ids=lambda path: path.stem)
def test_traces_that_were_found(path: Path) -> None:
    traces.examine(path.read_bytes())


def _inputs(write_seeds: Write, folder: Path) -> list[bytes]:
    write_seeds(folder)
    return [path.read_bytes() for path in sorted(folder.iterdir())]


@pytest.mark.parametrize("each", first(1, [4, 1]))
def test_programs_and_their_variations(each: int, tmp_path: Path) -> None:
    random = Random(1)
    for data in _inputs(texts.write_seeds, tmp_path)[::each]:
        texts.examine(data)
        texts.examine(texts.varied(data, random))


@pytest.mark.parametrize("count", first(1, [5, 20]))
def test_traces_and_their_variations(count: int, tmp_path: Path) -> None:
    random = Random(1)
    for data in _inputs(traces.write_seeds, tmp_path):
        traces.examine(data)
        for _ in range(count):
            traces.examine(traces.varied(data, random))


def test_bytes_that_are_no_text() -> None:
    for data in (b"", b"\xff\xfe\x00", bytes(range(256)) * 4):
        texts.examine(data)
        traces.examine(data)


def test_without_atheris_it_says_so_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "atheris", None)
    assert driving.fuzz("tests.fuzz.texts", []) == 0
    assert driving.NO_ATHERIS in capsys.readouterr().err
