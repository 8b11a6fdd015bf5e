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
