"""ARCHITECTURE.md and the guides of the rooms are true: rooms, floors, files that they name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_floors import ALLOWED, ROOT

GUIDE = ROOT / "ARCHITECTURE.md"
GUIDES = sorted((ROOT / "koord").rglob("README.md"))

#: What a person reads in ten minutes, at 200 words a minute.
TEN_MINUTES = 2_000

#: A row of the table of rooms: the room, and what it may import.
_ROOM = re.compile(r"^\| `koord/(\w+)/` \|[^|]*\|([^|]*)\|$", re.MULTILINE)

#: What looks like a file or folder of this tree.
_PATH = re.compile(r"`([\w./]+(?:\.py|\.md|\.lark|\.krd|/))`")


def rooms() -> dict[str, set[str]]:
    """What the table says that each room may import."""
    found = {
        room: set(re.findall(r"`(\w+)`", below))
        for room, below in _ROOM.findall(GUIDE.read_text("utf-8"))
    }
    above = set(found) - {"api", "lsp", "cli", "plugins"}
    found["api"] = above
    return found


def folders() -> set[str]:
    return {path.parent.name for path in (ROOT / "koord").glob("*/__init__.py")}


def test_the_table_lists_all_rooms_and_no_other() -> None:
    assert set(rooms()) == folders()


def test_rooms_may_import_what_the_table_says() -> None:
    for room, below in rooms().items():
        if room != "cli":
            allowed = {module.split(".")[1] for module in ALLOWED[room]}
            assert below | {room} == allowed, room


def test_rooms_stand_above_all_that_they_import() -> None:
    order = [room for room, _ in _ROOM.findall(GUIDE.read_text("utf-8"))]
    for room, below in rooms().items():
        assert all(order.index(other) < order.index(room) for other in below), room


def test_it_is_read_in_ten_minutes() -> None:
    assert len(GUIDE.read_text("utf-8").split()) <= TEN_MINUTES


def test_every_room_has_a_guide() -> None:
    assert {path.parent.name for path in GUIDES if path.parent.parent.name == "koord"} == folders()


@pytest.mark.parametrize("guide", [GUIDE, *GUIDES], ids=lambda path: str(path.relative_to(ROOT)))
def test_the_files_that_a_guide_names_exist(guide: Path) -> None:
    named = set(_PATH.findall(guide.read_text("utf-8")))
    assert named
    missing = sorted(path for path in named if not _exists(guide, path))
    assert missing == []


def _exists(guide: Path, path: str) -> bool:
    """From the root; in the guide of a room also from its folder, those in it, and `koord/`."""
    starts = [ROOT]
    if guide != GUIDE:
        starts += [ROOT / "koord", guide.parent]
        starts += [folder for folder in guide.parent.rglob("*") if folder.is_dir()]
    return any((start / path).exists() for start in starts)
