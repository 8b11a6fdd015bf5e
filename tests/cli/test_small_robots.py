"""`koord deploy` with Crazyflies and robots of the Robotarium that are processes of their own."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.testing.crazyflie.machine import Settings
from tests.cli.test_dry_run import ERRAND as ON_GROUND
from tests.cli.test_dry_run import positions
from tests.runtime.platform.test_crazyflie_process import crazyflie
from tests.runtime.platform.test_robotarium_process import FAKE, bridge

IN_THE_AIR = ON_GROUND.replace("pos(1, 0, 0)", "pos(0.5, -0.5, 0.6)")

FLYING = """\
delta: 0.1
agents:
    - {{pid: 0, on_device: drone, position: [0, 0]}}
devices:
    drone:
        bot_type: QUAD
        planner: RRT_DRONE
        driver: crazyflie
        options: {{uri: "{uri}", climb: 1{more}}}
world:
    bounds: {{low: [-4, -4, 0], high: [4, 4, 3]}}
"""

DRIVING = """\
delta: 0.1
agents:
    - {{pid: 0, on_device: rover, position: [0, 0]}}
devices:
    rover:
        bot_type: DIFF
        planner: RRT_DIFF
        speed: 0.15
        driver: robotarium
        options: {{bridge: "{where}"{more}}}
world:
    bounds: {{low: [-1.6, -1, 0], high: [1.6, 1, 1]}}
"""


def files(folder: Path, program: str, configuration: str) -> list[str]:
    (folder / "errand.krd").write_text(program, encoding="utf-8")
    (folder / "errand.yaml").write_text(configuration, encoding="utf-8")
    return [str(folder / "errand.krd"), str(folder / "errand.yaml")]


@pytest.mark.slow
@pytest.mark.sample
def test_a_program_takes_a_crazyflie_to_a_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "run.mcap"
    with crazyflie(Settings(arms_itself=False)) as (host, port):
        configuration = FLYING.format(uri=f"udp://{host}:{port}", more="")
        run = files(tmp_path, IN_THE_AIR, configuration)
        code = main(["deploy", *run, "--all-local", "--arm", "--yes", "--record", str(recording)])
    said = capsys.readouterr()
    assert code == Exit.OK, said
    assert "all robots have stopped" in said.out
    flown = positions(recording, 0)
    assert max(z for _, _, z in flown) > 0.45
    assert min(math.dist(there, (0.5, -0.5, 0.6)) for there in flown) <= 0.2


@pytest.mark.slow
@pytest.mark.sample
def test_a_program_takes_a_robot_of_the_arena_to_a_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "run.mcap"
    with bridge(FAKE, "0,0,0") as where:
        run = files(tmp_path, ON_GROUND, DRIVING.format(where=where, more=""))
        code = main(["deploy", *run, "--all-local", "--arm", "--yes", "--record", str(recording)])
    said = capsys.readouterr()
    assert code == Exit.OK, said
    assert min(math.dist(there, (1.0, 0.0, 0.0)) for there in positions(recording, 0)) <= 0.2


@pytest.mark.parametrize(
    ("configuration", "told", "cure"),
    [
        (
            FLYING.format(uri="udp://127.0.0.1:9", more=", connect: 0.5"),
            "robot 0: nothing is heard of the Crazyflie at `udp://127.0.0.1:9`",
            "is it switched on?",
        ),
        (
            DRIVING.format(where="127.0.0.1:9", more=", connect: 0.5"),
            "robot 0: no bridge to the Robotarium answers at 127.0.0.1:9",
            "koord.runtime.drivers.robotarium.bridge",
        ),
    ],
    ids=["crazyflie", "robotarium"],
)
def test_nobody_at_the_other_end_is_an_error_at_the_start(
    configuration: str, told: str, cure: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = files(tmp_path, ON_GROUND, configuration)
    assert main(["deploy", *run, "--all-local"]) != Exit.OK
    said = capsys.readouterr().err
    assert told in said
    assert cure in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("configuration", "told"),
    [
        (FLYING.format(uri="radio://0/80", more=""), "no address of a Crazyflie"),
        (FLYING.format(uri="usb://0", more=", hover: 1"), "unknown field `hover`"),
        (DRIVING.format(where="10.0.0.1:5550", more=""), "no address of this machine"),
    ],
)
def test_an_option_that_is_wrong_is_named_with_its_place(
    configuration: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = files(tmp_path, ON_GROUND, configuration)
    assert main(["config", "check", run[1]]) != Exit.OK
    assert told in capsys.readouterr().out
