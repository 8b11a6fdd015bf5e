"""`koord deploy` with an aircraft whose autopilot is a process of its own."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.testing.autopilot.machine import Settings
from koord.testing.sockets import Address
from tests.cli.test_dry_run import ERRAND as ON_GROUND
from tests.cli.test_dry_run import positions
from tests.runtime.platform.autopilots import autopilot

ERRAND = ON_GROUND.replace("pos(1, 0, 0)", "pos(0.5, -0.5, 0.6)")

CONFIG = """\
delta: 0.1
agents:
    - {{pid: 0, on_device: drone, position: [0, 0]}}
devices:
    drone:
        bot_type: QUAD
        planner: RRT_DRONE
        driver: mavlink
        options: {{connection: "udpout:{host}:{port}", takeoff_height: 0.5, climb: 1{more}}}
world:
    bounds: {{low: [-4, -4, 0], high: [4, 4, 3]}}
"""


def files(folder: Path, address: Address, more: str = "") -> list[str]:
    program, configuration = folder / "errand.krd", folder / "errand.yaml"
    program.write_text(ERRAND, encoding="utf-8")
    host, port = address
    configuration.write_text(CONFIG.format(host=host, port=port, more=more), encoding="utf-8")
    return [str(program), str(configuration)]


@pytest.mark.slow
@pytest.mark.parametrize("firmware", ["px4", "ardupilot"])
def test_a_program_takes_an_aircraft_to_a_place(
    firmware: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "run.mcap"
    with autopilot(Settings(firmware, stream_loss_s=30.0, ground_loss_s=30.0)) as address:
        run = files(tmp_path, address, f", autopilot: {firmware}, silence: 30")
        code = main(["deploy", *run, "--all-local", "--arm", "--yes", "--record", str(recording)])
    said = capsys.readouterr()
    assert code == Exit.OK, said
    assert "all robots have stopped" in said.out
    flown = positions(recording, 0)
    assert max(z for _, _, z in flown) > 0.45
    nearest = min(math.dist(there, (0.5, -0.5, 0.6)) for there in flown)
    assert nearest <= 0.2


def test_nobody_at_the_other_end_is_an_error_at_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = files(tmp_path, ("127.0.0.1", 9), ", connect: 0.2")
    assert main(["deploy", *run, "--all-local"]) != Exit.OK
    said = capsys.readouterr()
    assert re.search(r"robot 0: nothing is heard of system 1 at `udpout:127.0.0.1:9`", said.err)


def test_an_option_that_is_wrong_is_named_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = files(tmp_path, ("127.0.0.1", 9), ", autopilot: inav")
    assert main(["config", "check", run[1]]) != Exit.OK
    assert "inav" in capsys.readouterr().out
