"""Fleets for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.deployed.fleet import Fleet

MakeFleet = Callable[..., Fleet]


@pytest.fixture
def fleet_of(tmp_path: Path) -> Iterator[MakeFleet]:
    """Makes a fleet of so many robots, none of which runs yet; all end with the test."""
    pytest.importorskip("mcap")
    with ExitStack() as stack:
        made = 0

        def make(robots: int, **common: Any) -> Fleet:
            nonlocal made
            made += 1
            folder = tmp_path / f"fleet{made}"
            folder.mkdir()
            return stack.enter_context(Fleet(folder, robots, **common))

        yield make
