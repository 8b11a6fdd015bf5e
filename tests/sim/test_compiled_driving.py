"""Predictive controllers by machine code: bit for bit those of NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from koord.runtime.motion.bodies import Car
from koord.runtime.motion.predictive import Predictive
from koord.runtime.motion.pursuit import Horizon
from tests.runtime.motion.test_predictive import Asked

compiled_driving = pytest.importorskip("koord.sim.vehicles.compiled_driving")


@pytest.mark.parametrize("improved", [False, True])
@pytest.mark.parametrize("width", [2, 4, 8])
def test_machine_code_drives_as_numpy_does(
    width: int, improved: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """That which is kept, too, which LLVM's passes have improved."""
    if width > compiled_driving.widest():
        pytest.skip("this processor's registers hold less")
    if improved:
        monkeypatch.setenv("KOORD_CACHE", str(tmp_path))
    compiled_driving._solver.cache_clear()
    monkeypatch.setattr(compiled_driving, "_width", lambda: width)
    horizon, count = Horizon(4, 0.1) if width == 2 else Horizon(), 19
    asked, last = Asked(count, horizon, width), np.zeros((count, 2))
    one = Predictive(count, Car(), horizon)
    other = compiled_driving.CompiledPredictive(count, Car(), horizon)
    for k in range(12):
        cars = np.flatnonzero(np.arange(count) % 5 != k)
        error, course, way = asked()
        told = (
            error[cars],
            type(course)(course.speed_mps[cars], course.curvature[cars], course.slowest_mps),
            way[cars],
            last[cars],
        )
        found = one.inputs(cars, *told)
        assert found.tobytes() == other.inputs(cars, *told).tobytes()
        assert one.kept.tobytes() == other.kept.tobytes()
        last[cars] = found
    compiled_driving._solver.cache_clear()
