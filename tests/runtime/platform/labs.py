"""The lab of specs/platforms, as if it were installed."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

LAB = Path(__file__).parents[3] / "specs" / "platforms" / "lab"


def installed(folder: Path) -> list[str]:
    """Write what an installation of the lab leaves; return where its packages are found."""
    told = tomllib.loads((LAB / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = folder / f"{told['name']}-{told['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: {told['name']}\nVersion: {told['version']}\n")
    lines = []
    for group, entries in told["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return [str(folder), str(LAB)]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The lab, for this process and those that it starts."""
    places = installed(tmp_path)
    for place in places:
        monkeypatch.syspath_prepend(place)
    monkeypatch.setenv("PYTHONPATH", ":".join([*places, *filter(None, sys.path)]))
    return LAB
