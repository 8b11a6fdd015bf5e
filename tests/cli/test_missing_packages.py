"""Each optional package that a command needs: what is said where it is not installed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
LEADER, CARS = str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")
PATH = str(EXAMPLES / "follow_path.krd")
SIM = ("sim", PATH, "--no-html", "--time", "0.2")

CASES = {
    **{
        f"{library} of sim": (library, "sim", SIM)
        for library in ("numpy", "ompl", "osqp", "pymunk", "scipy", "shapely")
    },
    "mcap of sim": ("mcap", "sim", (*SIM, "--record", "run.mcap")),
    "sim of check-refinement": (
        "ompl",
        "sim",
        ("check-refinement", PATH, "--target", "simulator", "--runs", "1"),
    ),
    "rerun": ("rerun", "export", (*SIM, "--record", "run.rrd")),
    "rosbags": ("rosbags", "export", (*SIM, "--record", "run.rosbag2")),
    "viser": ("viser", "view", ("sim", PATH, "--view", "3d", "--html", "run.html")),
    "matplotlib of a run": ("matplotlib", "plot", (*SIM, "--plot", "run.svg")),
    "matplotlib of a campaign": ("matplotlib", "plot", (*SIM, "--runs", "2", "--plot", "a.svg")),
    "matplotlib of a sweep": (
        "matplotlib",
        "plot",
        ("verify", LEADER, "--robots", "2..3", "--plot", "a.svg"),
    ),
    "distributed": ("distributed", "cluster", (*SIM, "--runs", "2", "--cluster", "tcp://x:1")),
    "mujoco": ("mujoco", "mujoco", ("sim", PATH, "one.yaml", "--no-html", "--time", "0.2")),
    "numba": ("numba", "fast", ("sim", PATH, "two.yaml", "--no-html", "--time", "0.2")),
    "cvc5": ("cvc5", "recheck", ("recheck", "cert.json")),
    "mcap of deploy": (
        "mcap",
        "record",
        ("deploy", LEADER, CARS, "--all-local", "--record", "run.mcap"),
    ),
    "zenoh": ("zenoh", "zenoh", ("deploy", LEADER, "zenoh.yaml", "--pid", "0")),
}

LEVEL = "num_robots: 1\npositions: {{0: [0, 0, 1]}}\ndevice: {{bot_type: QUAD, {}}}\n"
FILES = {
    "one.yaml": LEVEL.format("planner: STRAIGHT, simulation: {level: mujoco}"),
    "two.yaml": LEVEL.format("planner: STRAIGHT, simulation: {level: fast}"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_package_that_is_missing_is_named_with_its_extra(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    library, extra, words = CASES[name]
    monkeypatch.chdir(tmp_path)
    for file, text in FILES.items():
        Path(file).write_text(text, "utf-8")
    cars = Path(CARS).read_text("utf-8")
    Path("zenoh.yaml").write_text(
        cars + "\nnetwork: {transport: zenoh, key: 4919c99959ed5836a546937f5c180e9a}\n", "utf-8"
    )
    if words[0] == "recheck":
        flags = ["--robots", "2", "--certificate", "cert.json"]
        assert main(["verify", LEADER, *flags]) == Exit.OK
        capsys.readouterr()
    before = sorted(path.name for path in tmp_path.iterdir())
    # Neither the package nor anything in it can be imported.
    for known in [one for one in sys.modules if one.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, known)
    monkeypatch.setitem(sys.modules, library, None)
    code = main(list(words))
    out, err = capsys.readouterr()
    assert f"pip install 'koord[{extra}]'" in out + err, (out, err)
    assert code == Exit.BAD_INPUT
    assert "Traceback" not in out + err
    left = sorted(path.name for path in tmp_path.iterdir() if path.name != ".koord")
    assert left == before  # but for the folder of robots' journals
