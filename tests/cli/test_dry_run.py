"""`koord deploy --dry-run`: processes that drive simulated vehicles, in real time."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.sim.scene import TRACKING_M

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: A robot that drives to a place, and then stops.
ERRAND = """\
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos target
local:
    boolean isSent = false
Go:
    pre: not isSent
    eff:
        Motion.target = pos(1, 0, 0)
        isSent = true
Stop:
    pre: isSent and Motion.reached
    eff: stop
"""

CONFIG = """\
delta: 0.1
agents:
    - {pid: 0, on_device: car, position: [0, 0]}
devices:
    car: {bot_type: CAR, planner: STRAIGHT}
world:
    bounds: {low: [-4, -4, 0], high: [4, 4, 3]}
"""


def positions(recording: Path, pid: int) -> list[tuple[float, float, float]]:
    reader = pytest.importorskip("mcap.reader")
    with recording.open("rb") as file:
        found = [
            json.loads(message.data)["position"]
            for _, _, message in reader.make_reader(file).iter_messages(topics=[f"/robots/{pid}"])
        ]
    return [(x, y, z) for x, y, z in found]


def test_vehicles_go_where_programs_send_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, config = tmp_path / "errand.krd", tmp_path / "errand.yaml"
    program.write_text(ERRAND, encoding="utf-8")
    config.write_text(CONFIG, encoding="utf-8")
    record, trace = tmp_path / "run.mcap", tmp_path / "run.json"
    words = ["deploy", str(program), str(config), "--dry-run", "--all-local"]
    code = main([*words, "--record", str(record), "--trace", str(trace)])
    out, err = capsys.readouterr()
    assert code == Exit.OK, out + err
    assert "every step legal" in out
    way = positions(record, 0)
    assert math.dist(way[0], (0, 0, 0)) < 0.01
    assert math.dist(way[-1], (1, 0, 0)) <= 0.2
    # It drove: in no round further than a car gets.
    assert max(math.dist(a, b) for a, b in itertools.pairwise(way)) < 0.25


@pytest.mark.slow
def test_cars_and_drones_visit_all_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's Task, in real time: about two minutes."""
    record = tmp_path / "run.mcap"
    files = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task.yaml")]
    code = main(["deploy", *files, "--dry-run", "--all-local", "--record", str(record)])
    out, err = capsys.readouterr()
    assert code == Exit.OK, out + err
    assert "all robots have stopped" in out
    gaps = [
        math.dist(a, b)
        for one in range(3)
        for other in range(one)
        for a, b in zip(positions(record, one), positions(record, other), strict=False)
    ]
    assert min(gaps) > 0.6 - 2 * TRACKING_M


def deployed(
    folder: Path, program: str, config: str, *words: str, capsys: pytest.CaptureFixture[str]
) -> str:
    """What is told of a deployment that is refused."""
    source, path = folder / "errand.krd", folder / "errand.yaml"
    source.write_text(program, encoding="utf-8")
    path.write_text(config, encoding="utf-8")
    code = main(["deploy", str(source), str(path), "--all-local", "--rounds", "2", *words])
    assert code == Exit.BAD_INPUT
    return capsys.readouterr().err


def test_a_vehicle_that_nothing_drives_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    err = deployed(tmp_path, ERRAND, CONFIG, capsys=capsys)
    assert "errand.yaml:5:21: error K932: nothing drives car, a CAR" in err


@pytest.mark.parametrize(
    ("driver", "told"),
    [
        ("driver: simm", "there is no driver simm"),
        ("driver: sim, options: {baud: 3}", "unknown field `baud`"),
    ],
)
def test_a_driver_that_is_not_there_or_is_told_what_it_does_not_know(
    driver: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = CONFIG.replace("bot_type: CAR", f"bot_type: CAR, {driver}")
    assert told in deployed(tmp_path, ERRAND, config, capsys=capsys)


MODULES = """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target
using Arm:
    sensors:
        int load
    actuators:
        boolean grip
{environment}
Go:
    pre: Arm.load < 3
    eff: Arm.grip = true
"""

#: A model of the arm.
MODEL = """\
    environment:
        load = 1
"""


@pytest.mark.parametrize("driver", ["bot_type: CAR, driver: sim", "bot_type: IDEAL"])
def test_ports_that_nobody_serves_are_refused_with_their_places(
    driver: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-NOTHING-INVENTED)"""
    config = CONFIG.replace("bot_type: CAR", driver)
    err = deployed(tmp_path, MODULES.format(environment=""), config, capsys=capsys)
    assert "errand.krd:8:" in err
    assert "does not sense Arm.load" in err
    assert "errand.krd:10:" in err
    assert "does nothing with Arm.grip" in err


def test_a_model_of_an_environment_is_no_environment(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = CONFIG.replace("bot_type: CAR", "bot_type: IDEAL")
    program = MODULES.format(environment=MODEL)
    err = deployed(tmp_path, program, config, capsys=capsys)
    assert "Arm.load would be made up by the model of Arm" in err
    allowed = ["--allow-model", "Arm.load", "--allow-model", "Arm.grip"]
    err = deployed(tmp_path, program, config, *allowed, "--allow-model", "Arm.lod", capsys=capsys)
    assert "there is no port Arm.lod to be made up" in err
    assert "would be made up" not in err


def test_what_may_be_made_up_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, path = tmp_path / "errand.krd", tmp_path / "errand.yaml"
    source.write_text(MODULES.format(environment=MODEL), encoding="utf-8")
    path.write_text(CONFIG.replace("bot_type: CAR", "bot_type: IDEAL"), encoding="utf-8")
    words = ["--allow-model", "Arm.load", "--allow-model", "Arm.grip", "--as-fast-as-possible"]
    code = main(["deploy", str(source), str(path), "--all-local", "--rounds", "3", *words])
    assert code == Exit.OK, capsys.readouterr().err


def test_vehicles_take_their_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--dry-run", "--as-fast-as-possible"]
    assert "vehicles take their time" in deployed(tmp_path, ERRAND, CONFIG, *words, capsys=capsys)
