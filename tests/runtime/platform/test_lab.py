"""The lab of specs/platforms in real time: its driver in the kit, its program in a dry run."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

import koord
from tests.runtime.platform.labs import lab as lab
from tests.testing.alone import failing_alone


@pytest.mark.slow
def test_the_labs_driver_passes_the_kit(lab: Path) -> None:
    peer = f"{sys.executable} -m mylab.firmware --port {{free}} --start 1 0.5 0.3"
    conform = partial(
        koord.conform,
        "mylab_car",
        options={"port": "{free}"},
        peer=peer,
        at_m=(1.0, 0.5, 0.0),
        heading_rad=0.3,
    )
    told = conform(jobs=2)
    assert failing_alone(told, lambda only: conform(only=only)) == ()
    assert {one.check for one in told.findings if one.verdict.value == "skipped"} == {
        "battery",
        "lands",
    }


@pytest.mark.slow
def test_a_dry_run_does_with_the_lab_what_a_simulation_does(lab: Path, tmp_path: Path) -> None:
    words = ["deploy", "--dry-run", "--all-local", "--rounds", "1500", "--json", "--trace"]
    files = [str(lab / "fetch.krd"), str(lab / "fetch.yaml")]
    ran = subprocess.run(
        [sys.executable, "-m", "koord", *words, str(tmp_path / "trace.json"), *files],
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
