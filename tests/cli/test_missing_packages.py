"""Each optional package that a command needs: what is said where it is not installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.motion.libraries import missing
from tests.sampling import first

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "specs" / "examples"
LEADER, CARS = str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")
PATH = str(EXAMPLES / "follow_path.krd")
SIM = ("sim", PATH, "--no-html", "--time", "0.2")

CASES = {
    **{
        f"{library} of sim": (library, "sim", SIM)
        for library in ("numpy", "ompl", "pymunk", "scipy", "shapely")
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
    "pyarrow": ("pyarrow", "parquet", (*SIM, "--runs", "2", "--parquet", "runs.parquet")),
    "distributed": ("distributed", "cluster", (*SIM, "--runs", "2", "--cluster", "tcp://x:1")),
    "mujoco": ("mujoco", "mujoco", ("sim", PATH, "one.yaml", "--no-html", "--time", "0.2")),
    "llvmlite": ("llvmlite", "fast", ("sim", PATH, "two.yaml", "--no-html", "--time", "0.2")),
    "cvc5": ("cvc5", "recheck", ("recheck", "cert.json")),
    "mcap of deploy": (
        "mcap",
        "record",
        ("deploy", LEADER, CARS, "--all-local", "--record", "run.mcap"),
    ),
    "cryptography": (
        "cryptography",
        "encrypt",
        ("deploy", LEADER, "encrypted.yaml", "--all-local"),
    ),
    "zenoh": ("zenoh", "zenoh", ("deploy", LEADER, "zenoh.yaml", "--pid", "0")),
}

LEVEL = "num_robots: 1\npositions: {{0: [0, 0, 0]}}\ndevice: {{bot_type: QUAD, {}}}\n"
FILES = {
    "encrypted.yaml": "num_robots: 2\nnetwork: {encrypt: true}\n",
    "one.yaml": LEVEL.format("planner: STRAIGHT, simulation: {level: mujoco}"),
    "two.yaml": LEVEL.format("planner: STRAIGHT, simulation: {level: fast}"),
}


#: Koord with one package less: neither it nor anything in it can be imported.
WITHOUT = (
    "import sys; sys.modules[sys.argv.pop(1)] = None; from koord.cli.main import entry; entry()"
)

#: What extras bring: those modules that koord imports itself.
GONE = (
    "asyncssh cflib cryptography cvc5 cyclonedds distributed llvmlite matplotlib mcap mujoco numpy"
    " ompl pyarrow pygls pymap3d pymavlink pymunk pynmea2 rerun rosbags scipy shapely shtab viser"
    " websockets zenoh"
)

#: Koord alone: no package of an extra can be imported.
ALONE = """
import sys
from importlib.machinery import PathFinder
gone = set(sys.argv.pop(1).split())
class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.split(".")[0] in gone else PathFinder.find_spec(name, path, target)
sys.meta_path[:] = [Finder if one is PathFinder else one for one in sys.meta_path]
from koord.cli.main import entry
entry()
"""


@pytest.mark.parametrize("words", first(1, ["doctor", "cache", "drivers"]))
def test_koord_alone_tells_of_itself(words: str, tmp_path: Path) -> None:
    """Whoever has no extra asks what there is: that answer needs none."""
    done = subprocess.run(
        [sys.executable, "-c", ALONE, GONE, words],
        env={**os.environ, "PYTHONPATH": str(ROOT), "KOORD_CACHE": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (Exit.OK, "")
    assert done.stdout
    assert "ModuleNotFoundError" not in done.stdout


def test_several_packages_are_told_as_several() -> None:
    told = [missing(library, "gps").diagnostics[0].message for library in ("a", "a, b")]
    assert told == [
        "a is needed for this and is not installed",
        "a, b are needed for this and are not installed",
    ]


#: Those of a default run; tests/test_readme.py has others.
OFTEN = ("ompl of sim", "mcap of deploy", "zenoh")


@pytest.mark.parametrize("name", first(len(OFTEN), dict.fromkeys((*OFTEN, *CASES))))
def test_a_package_that_is_missing_is_named_with_its_extra(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    before = sorted(path.name for path in tmp_path.iterdir())
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, library, *words],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    said = done.stdout + done.stderr
    assert f"pip install 'koord[{extra}]'" in said
    assert done.returncode == Exit.BAD_INPUT
    assert "Traceback" not in said
    left = sorted(path.name for path in tmp_path.iterdir() if path.name != ".koord")
    assert left == before  # but for the folder of robots' journals
