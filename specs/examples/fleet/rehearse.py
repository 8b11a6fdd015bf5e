"""Rehearse *Task* with two cars of ROS 2 and a drone of PX4, all of them simulated.

Everything but the vehicles is as on the day: a process of `koord deploy` for each robot, their
protocol over UDP, ROS 2 and MAVLink, and a motion capture that says where they are. At the end the
run is judged, and so is where the vehicles really were:

    python specs/examples/fleet/rehearse.py
    python specs/examples/fleet/rehearse.py --lose 0.3 --kill 1:8 --blind 2:20

The first visits all places. In the second 30 % of all datagrams are lost, the process of robot 1 is
killed 8 s after all vehicles have begun to move, and robot 2 is not seen by the cameras any more
12 s after that: nobody leaves the arena, nobody comes too close to another one, and who cannot know
where it is holds, and lands.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from koord import read_configuration

HERE = Path(__file__).parent
PROGRAM = HERE / "task_fleet.krd"

#: Where the cameras are told where the vehicles are, and where they tell it.
_NATNET, _TOLD = ("127.0.0.1", 1510), ("127.0.0.1", 1512)
_AUTOPILOT = ("127.0.0.1", 14590)

#: The arena of the configuration, and how near two vehicles may come: no two of them touch then.
_LOW, _HIGH, _APART_M = (-3.5, -4.0, -0.1), (3.5, 4.0, 3.0), 0.5

#: What is so far from where it began moves.
_MOVES_M = 0.5

#: So near to a place it has been visited.
_THERE_M = 0.25

#: A vehicle that holds has drifted less than this after it stood.
_HELD_M, _STANDS_S = 0.5, 3.0

BODIES = ("car0", "car1", "drone")


class Incident(NamedTuple):
    """What happens to a robot, and how many seconds after all vehicles have begun to move."""

    pid: int
    at_s: float

    @staticmethod
    def of(text: str) -> Incident:
        pid, _, at_s = text.partition(":")
        return Incident(int(pid), float(at_s))


class Truth(threading.Thread):
    """Where the vehicles are, as they say themselves: noted, and passed on to the cameras."""

    def __init__(self) -> None:
        super().__init__(name="truth", daemon=True)
        self.seen: dict[str, list[tuple[float, tuple[float, float, float]]]] = {}
        self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.port.bind(("127.0.0.1", 0))
        self.address: tuple[str, int] = self.port.getsockname()

    def run(self) -> None:
        while True:
            data = self.port.recv(4096)
            if not data:
                return
            told = json.loads(data)
            x, y, z = told["position"]
            self.seen.setdefault(told["body"], []).append((time.monotonic(), (x, y, z)))
            self.port.sendto(data, _TOLD)

    @property
    def moving_s(self) -> float:
        """How long ago all vehicles had begun to move; less than 0: they have not."""
        begun_s = 0.0
        for body in BODIES:
            told = [*self.seen.get(body, [])]
            moved = (at_s for at_s, place in told if math.dist(place, told[0][1]) > _MOVES_M)
            begun_s = max(begun_s, next(moved, math.inf))
        return time.monotonic() - begun_s

    def tell_cameras(self, **what: object) -> None:
        """Let something happen to the cameras."""
        self.port.sendto(json.dumps(what).encode(), _TOLD)

    def end(self) -> None:
        """Note no more."""
        self.port.sendto(b"", self.address)
        self.join()
        self.port.close()


@contextmanager
def started(*words: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is ended afterwards; what it says goes to a file."""
    with log.open("wb") as file:
        process = subprocess.Popen([sys.executable, "-m", *words], stdout=file, stderr=file)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(30)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def vehicles(stack: ExitStack, truth: Truth, folder: Path) -> dict[str, subprocess.Popen[bytes]]:
    """Start the cameras, the cars and the autopilot; return their processes by name."""
    made = {}
    where = f"{truth.address[0]}:{truth.address[1]}"
    bodies = [word for body in BODIES for word in ("--body", body)]
    cameras = "koord.testing.natnet", *bodies, "--told", f"{_TOLD[0]}:{_TOLD[1]}"
    made["cameras"] = stack.enter_context(started(*cameras, log=folder / "cameras.log"))
    for name, start in (("car0", (-2.5, -3.0, 1.57)), ("car1", (2.5, 3.0, -1.57))):
        words = ["koord.testing.ros2.serving", "--prefix", name, "--truth", where]
        words += ["--start", *map(str, start)]
        made[name] = stack.enter_context(started(*words, log=folder / f"{name}.log"))
    words = ["koord.testing.autopilot.serving", "--bind", f"{_AUTOPILOT[0]}:{_AUTOPILOT[1]}"]
    words += ["--vision", "--truth", where, "--start", "-2.5", "2.5", "0"]  # north, east, down
    made["drone"] = stack.enter_context(started(*words, log=folder / "drone.log"))
    return made


def koord(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    command = [sys.executable, "-m", "koord", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


class Rehearsal(NamedTuple):
    """What a rehearsal was like."""

    took_s: float
    is_over: bool  #: the robots came to the end by themselves
    is_seen: bool  #: where each vehicle was is known
    visited: int  #: places of tasks where a vehicle was
    tasks: int
    nearest_m: float
    outside_m: float  #: how far somebody was outside of the arena at most
    drifted_m: dict[int, float]  #: by robot that was not seen any more: after it had to stand
    judged: str  #: what `koord merge` says of the trace
    said: list[str]  #: what robots told

    @property
    def is_safe(self) -> bool:
        """True if nobody left the arena, nobody came too close, and who was lost held."""
        held = all(one <= _HELD_M for one in self.drifted_m.values())
        return self.is_seen and self.nearest_m >= _APART_M and self.outside_m <= 0 and held

    def __str__(self) -> str:
        lines = [
            f"{self.visited} of {self.tasks} places visited in {self.took_s:.0f} s",
            f"no two vehicles nearer than {self.nearest_m:.2f} m (wanted: {_APART_M} m)",
            f"nobody left the arena (by {self.outside_m:.2f} m)"
            if self.outside_m > 0
            else f"everybody stayed {-self.outside_m:.2f} m within the arena",
        ]
        lines += [
            f"robot {pid}, not seen any more, stood within {drift:.2f} m"
            for pid, drift in self.drifted_m.items()
        ]
        return "\n".join([*self.said, *lines, self.judged])


def rehearse(
    lose: float = 0.0,
    kill: Incident | None = None,
    blind: Incident | None = None,
    most_s: float = 180.0,
    folder: Path | None = None,
) -> Rehearsal:
    """Rehearse the run, with what is to happen in it."""
    with ExitStack() as stack:
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        config = folder / "task_fleet.yaml"
        config.write_text((HERE / "task_fleet.yaml").read_text("utf-8"), "utf-8")
        koord("config", "key", str(folder / "fleet.key"))
        truth = Truth()
        truth.start()
        stack.callback(truth.end)
        served, robots = vehicles(stack, truth, folder), []
        for pid in range(3):
            words = ("koord", "deploy", str(PROGRAM), str(config), "--pid", str(pid), "--arm")
            words += ("--yes", "--fresh", "--state", str(folder / "journals"))
            words += ("--trace", str(folder / f"part{pid}.jsonl"), "--lose", str(lose))
            robots.append(stack.enter_context(started(*words, log=folder / f"robot{pid}.log")))
        begun_s = time.monotonic()
        blinded_s = _happen(robots, truth, begun_s, kill, blind, most_s)
        for name, process in served.items():
            if process.poll() is not None:
                said = (folder / f"{name}.log").read_text("utf-8", "replace").strip()
                raise RuntimeError(f"{name} has ended, and nothing was rehearsed: {said}")
        is_over = all(robot.poll() is not None for robot in robots)
        took_s = time.monotonic() - begun_s
        for robot in robots:
            if robot.poll() is None:
                robot.send_signal(signal.SIGTERM)
        for robot in robots:
            robot.wait(60)
        seen = {body: list(told) for body, told in truth.seen.items()}
        return _judged(folder, seen, took_s, blind, blinded_s, is_over=is_over)


def _happen(
    robots: list[subprocess.Popen[bytes]],
    truth: Truth,
    begun_s: float,
    kill: Incident | None,
    blind: Incident | None,
    most_s: float,
) -> float | None:
    """Let things happen until the run is over; return since when somebody is not seen."""
    blinded_s = None
    while time.monotonic() - begun_s < most_s:
        now_s = truth.moving_s
        if kill is not None and now_s >= kill.at_s and robots[kill.pid].poll() is None:
            robots[kill.pid].kill()
        if blind is not None and now_s >= blind.at_s and blinded_s is None:
            truth.tell_cameras(body=BODIES[blind.pid], tracked=False)
            blinded_s = time.monotonic()
        gone = [robot.poll() is not None for robot in robots]
        if all(gone[pid] for pid in range(3) if kill is None or pid != kill.pid):
            break
        time.sleep(0.1)
    return blinded_s


def _judged(
    folder: Path,
    seen: dict[str, list[tuple[float, tuple[float, float, float]]]],
    took_s: float,
    blind: Incident | None,
    blinded_s: float | None,
    *,
    is_over: bool,
) -> Rehearsal:
    """Judge what robots have told, and where their vehicles were."""
    trace = folder / "run.json"
    parts = sorted(map(str, folder.glob("part*.jsonl")))
    merged = koord("merge", *parts, "-o", str(trace))
    visited, tasks = _visits(folder / "task_fleet.yaml", seen)
    drifted = {}
    if blind is not None and blinded_s is not None:
        after = [at for at in seen[BODIES[blind.pid]] if at[0] > blinded_s + _STANDS_S]
        places = [place[:2] for _, place in after]
        drifted[blind.pid] = max((math.dist(places[0], one) for one in places), default=0.0)
    outside_m = max(
        max(low - c, c - high)
        for told in seen.values()
        for _, place in told
        for low, c, high in list(zip(_LOW, place, _HIGH, strict=True))
    )
    said = []
    for pid in range(3):
        lines = (folder / f"robot{pid}.log").read_text("utf-8", "replace").splitlines()
        said += [f"  robot {pid} | {line}" for line in lines]
    judged = (merged.stdout + merged.stderr).strip()
    near, is_seen = _nearest(seen), all(body in seen for body in BODIES)
    return Rehearsal(
        took_s, is_over, is_seen, visited, tasks, near, outside_m, drifted, judged, said
    )


def _nearest(seen: dict[str, list[tuple[float, tuple[float, float, float]]]]) -> float:
    """How near two vehicles came to each other."""
    nearest_m, latest = math.inf, dict[str, tuple[float, float, float]]()
    moments = sorted((at_s, body, place) for body, told in seen.items() for at_s, place in told)
    for _, body, place in moments:
        latest[body] = place
        others = (other for name, other in latest.items() if name != body)
        nearest_m = min(nearest_m, *(math.dist(place, other) for other in others), math.inf)
    return nearest_m


def _visits(
    config: Path, seen: dict[str, list[tuple[float, tuple[float, float, float]]]]
) -> tuple[int, int]:
    """At how many of the places of the tasks a vehicle has been."""
    places = read_configuration(config).world.tasks
    been = [place for told in seen.values() for _, place in told]
    near = (min(math.dist(place, one) for one in been) <= _THERE_M for place in places)
    return sum(near), len(places)


def main() -> int:
    """Rehearse from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lose", type=float, default=0.0, metavar="SHARE", help="of datagrams")
    parser.add_argument("--kill", type=Incident.of, metavar="PID:SECONDS")
    parser.add_argument("--blind", type=Incident.of, metavar="PID:SECONDS")
    parser.add_argument("--most", type=float, default=180.0, metavar="SECONDS")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where files are kept")
    told = parser.parse_args()
    if told.keep is not None:
        told.keep.mkdir(parents=True, exist_ok=True)
    done = rehearse(told.lose, told.kill, told.blind, told.most, told.keep)
    print(done)
    return 0 if done.is_safe else 1


if __name__ == "__main__":
    sys.exit(main())
