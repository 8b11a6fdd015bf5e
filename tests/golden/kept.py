"""The frozen transcripts as they are kept: a compressed text a scenario."""

from __future__ import annotations

import lzma
from collections.abc import Iterator
from difflib import unified_diff
from pathlib import Path

from tests.golden.scenarios import Scenario

#: Where they are kept.
FOLDER = Path(__file__).parent / "kept"


def file_of(scenario: Scenario) -> Path:
    """The file of a scenario."""
    return FOLDER / f"{scenario.name.replace('/', '.')}.txt.xz"


def is_kept(scenario: Scenario) -> bool:
    """Whether a scenario has been played before."""
    return file_of(scenario).exists()


def kept(scenario: Scenario) -> str:
    """The transcript that was frozen."""
    return lzma.decompress(file_of(scenario).read_bytes()).decode()


def keep(scenario: Scenario, text: str) -> None:
    """Freeze a transcript."""
    FOLDER.mkdir(exist_ok=True)
    file_of(scenario).write_bytes(lzma.compress(text.encode(), preset=9))


def difference(before: str, now: str) -> Iterator[str]:
    """The lines of a diff; nothing where the transcripts are equal."""
    if before != now:
        yield from unified_diff(before.splitlines(), now.splitlines(), "kept", "now", "", "", 2, "")
