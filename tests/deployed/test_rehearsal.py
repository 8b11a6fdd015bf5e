"""*Task* with cars of ROS 2 and a drone of PX4, located by NatNet: `rehearse.py` of examples."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.ports import held

SCRIPT = Path(__file__).parents[2] / "specs" / "examples" / "fleet" / "rehearse.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    for library in ("cyclonedds", "natnet", "pymavlink"):
        pytest.importorskip(library, reason=f"{library} is missing: pip install '.[dev]'")
    spec = importlib.util.spec_from_file_location("rehearse", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["rehearse"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def natnet() -> Iterator[None]:
    """The fake cameras, whose port the configuration says."""
    with held("natnet"):
        yield


@pytest.mark.slow
def test_first_places_are_visited_and_everybody_is_safe(script: ModuleType, tmp_path: Path) -> None:
    done = script.rehearse(most_s=30.0, folder=tmp_path)
    assert done.visited >= 1, done
    assert done.is_safe, done
    assert "every step legal" in done.judged, done


@pytest.mark.slow
def test_all_places_are_visited_and_the_trace_is_legal(script: ModuleType, tmp_path: Path) -> None:
    done = script.rehearse(folder=tmp_path)
    assert done.is_over, done
    assert done.visited == done.tasks == 6, done
    assert done.is_safe, done
    assert "every step legal" in done.judged
    assert not [line for line in done.said if "did not hold" in line]


@pytest.mark.slow
def test_with_loss_a_killed_robot_and_a_lost_localiser_everybody_is_safe(
    script: ModuleType, tmp_path: Path
) -> None:
    kill, blind = script.Incident(1, 8.0), script.Incident(2, 20.0)
    done = script.rehearse(lose=0.3, kill=kill, blind=blind, most_s=90.0, folder=tmp_path)
    assert done.is_safe, done
    assert done.drifted_m.keys() == {2}
    assert done.visited >= 1, done
    assert "every step legal" in done.judged, done
    assert "it tells nothing after round" in done.judged
    # Who is blind says so, and the others go on in their rounds.
    assert any("not tracked" in line for line in done.said if "robot 2 |" in line)
