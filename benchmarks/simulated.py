"""Simulated runs, the whole stack: program, rounds, claims, motion, vehicles, recording.

Fleets of 16 to 10,000: CPU seconds inside of a child process, with the recording and the files that
are made of it, without the start of the interpreter. Robots of *Squares* each fly or drive around a
square of their own and tell the others how far they are. *Task* over many seeds is in `paper.py`.

Machine code is kept in a folder of the benchmark's own, so that a run is one of those after the
first. Beside them are robots of ARGoS that drive straight ahead, at 100 Hz in the plane, without
a program, claims or recording, if there is a build of it: `ARGOS_BUILD` names its folder, or
`argos3` of one is in the PATH.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from harness import EXAMPLES, LIMITS, Cell, Column, Report, in_child, limited, main, measure, note

SQUARES = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target

allread:
    int[] corners = 0

local:
    pos home
    int visited = 0

def fun corner(pos home, int k) -> pos:
    float x = 0.0
    float y = 0.0
    if k % 4 == 1 or k % 4 == 2:
        x = 1.2
    if k % 4 == 2 or k % 4 == 3:
        y = 1.2
    return home + pos(x, y, 0.0)

init:
    home = Motion.psn
    Motion.target = Motion.psn

Next:
    pre: Motion.reached
    eff:
        visited = visited + 1
        corners[pid] = visited
        Motion.target = corner(home, visited)

invariant Told: corners[pid] == visited
invariant Near: abs(Motion.psn.x - home.x) <= 5 and abs(Motion.psn.y - home.y) <= 5
"""

DEVICES = {
    "drone": "{bot_type: QUAD, planner: RRT_DRONE}",
    "car": "{bot_type: CAR, planner: RRT_CAR}",
    "car, pursuit": "{bot_type: CAR, planner: RRT_CAR, simulation: {steering: PURSUIT}}",
    "point": "{bot_type: IDEAL, planner: STRAIGHT}",
}

#: Program, devices in turn, robots, seconds, least speed against real time.
FLEETS: tuple[tuple[str, tuple[str, ...], int, float, float | None], ...] = (
    ("lineform", ("drone",), 16, 120.0, 40.0),
    ("shapeform", ("drone",), 16, 120.0, 40.0),
    ("squares", ("car", "drone"), 16, 60.0, None),
    ("squares", ("car", "drone"), 100, 30.0, 40.0),
    ("squares", ("car", "drone"), 1_000, 6.0, 6.0),
    ("squares", ("car, pursuit", "drone"), 16, 60.0, None),
    ("squares", ("car, pursuit", "drone"), 1_000, 6.0, 6.0),
    ("squares", ("drone",), 16, 60.0, None),
    ("squares", ("drone",), 100, 30.0, None),
    ("squares", ("drone",), 1_000, 6.0, 2.0),
    ("squares", ("drone",), 10_000, 3.0, None),
    ("squares", ("point",), 10_000, 2.0, 0.5),
)


#: A run of so many seconds goes before, which makes machine code.
_WARM_S = 20.0


def squares(devices: tuple[str, ...], count: int) -> str:
    """A configuration: robots on a grid, six metres from each other."""
    side = math.ceil(math.sqrt(count))
    lines = ["delta: 0.1", "devices:"]
    lines += [f"    {name!r}: {DEVICES[name]}" for name in dict.fromkeys(devices)]
    lines.append("agents:")
    for k in range(count):
        name = devices[k % len(devices)]
        place = [6 * (k % side), 6 * (k // side), 0 if name.startswith("car") else 1]
        lines.append(f"    - {{pid: {k}, on_device: {name!r}, position: {place}}}")
    high = [6 * side, 6 * side, 3]
    lines.append(f"world: {{bounds: {{low: [-4, -4, 0], high: {high}}}}}")
    return "\n".join(lines) + "\n"


def begun(program: str, devices: str = "", count: int = 0) -> Any:
    """A run after INIT, as `koord sim` makes it. An example has its own configuration."""
    from koord.api.fitting import FitRequest, fit
    from koord.api.sim_setup import simulation
    from koord.runtime.configuration.checking import load
    from koord.sim.running import Simulation
    from koord.syntax.source import Source

    if program == "squares":
        text, configuration = SQUARES, squares(tuple(devices.split(" and ")), count)
    else:
        text = (EXAMPLES / f"{program}.krd").read_text("utf-8")
        configuration = (EXAMPLES / f"{program}.yaml").read_text("utf-8")
    source = Source(f"{program}.krd", text)
    request = FitRequest(source, load(Source("fleet.yaml", configuration)), (), {})
    made = simulation(fit(request), Simulation)
    made.begin()
    return made


def simulated(program: str, devices: str, count: int, seconds: float) -> dict[str, Any]:
    """What a run costs, and what it comes to."""
    import resource
    import time

    from koord.sim.files.mcap import mcap_of
    from koord.sim.running import run
    from koord.sim.viewing import page_of

    simulation = begun(program, devices, count)
    began = time.process_time()
    for _ in run(simulation, seconds):
        pass
    cpu_s = time.process_time() - began
    threads = len(list(Path("/proc/self/task").iterdir()))
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sizes: dict[str, float] = {}
    if count <= 16:  # files of crowds have figures of their own
        sizes["mcap_kib"] = len(mcap_of(simulation.recording)) / 1024
        sizes["html_kib"] = len(page_of(simulation.recording)) / 1024
    events = sum(robot.events for robot in simulation.figures().robots)
    return {
        "cpu_s": cpu_s,
        "start_s": began,  # from the process's start on
        "peak_mib": peak_mib,
        "threads": threads,
        "time_s": simulation.time_s,
        "broken": len(simulation.broken),
        "events": events,
        **sizes,
    }


def fleets(report: Report) -> None:
    """One row for each fleet."""
    table = report.table(
        "Fleets",
        Column("program", "program"),
        Column("devices", "robots of kind"),
        Column("count", "robots", 0),
        Column("seconds", "s simulated", 0),
        Column("cpu_s", "CPU s"),
        Column("times_real", "× real time", 1),
        Column("us", "µs per robot and s", 0),
        Column("start_s", "start CPU s"),
        Column("peak_mib", "MiB", 0),
        Column("threads", "threads", 0),
        Column("mcap_kib", "MCAP KiB", 0),
        Column("html_kib", "HTML KiB", 0),
        *LIMITS,
    )
    for program, devices, count, seconds, least in FLEETS:
        if report.quick and count > 100:
            continue
        note(f"{program}, {count} robots: {', '.join(devices)}")
        span = min(seconds, 10.0) if report.quick else seconds
        kinds = " and ".join(devices)
        in_child(simulated, program, kinds, count, min(span, _WARM_S), timeout_s=900.0)
        found = in_child(simulated, program, kinds, count, span, timeout_s=900.0)
        name = f"{program}, {count}"
        report.expect(found["broken"] == 0, f"{name}: {found['broken']} claims broken")
        report.expect(found["events"] >= count, f"{name}: nothing happened")
        report.expect(found["time_s"] >= span - 0.01, f"{name}: ended after {found['time_s']} s")
        row: dict[str, Cell] = {
            "program": program,
            "devices": kinds,
            "count": count,
            "seconds": span,
            "times_real": span / found["cpu_s"],
            "us": 1e6 * found["cpu_s"] / span / count,
        }
        for key in ("cpu_s", "start_s", "peak_mib", "threads", "mcap_kib", "html_kib"):
            row[key] = found.get(key)
        if least is not None:
            row |= limited(found["cpu_s"] / span, 1 / least, "s CPU per s")
        table.rows.append(row)


#: Robots of ARGoS, and seconds.
CROWDS = ((16, 60.0), (100, 30.0), (1_000, 6.0), (10_000, 2.0))

_CONTROLLER = "testing/foot-bot/drive_forward_dynamics2d"

EXPERIMENT = """\
<?xml version="1.0" ?>
<argos-configuration>
<framework><system threads="0"/>
<experiment length="{seconds}" ticks_per_second="10" random_seed="1"/></framework>
<controllers><test_controller library="{controller}" id="ahead">
<actuators><differential_steering implementation="default"/></actuators><sensors/><params/>
</test_controller></controllers>
<arena size="{wide},{wide},2" center="{middle},{middle},0.5" positional_index="grid"
 positional_grid_size="25,25,1">{robots}</arena>
<physics_engines><dynamics2d id="plane" iterations="10"/></physics_engines>
<media><range_and_bearing id="rab" index="grid" grid_size="3,3,3"/>
<led id="leds" index="grid" grid_size="3,3,3"/></media>
</argos-configuration>
"""

ROBOT = """\
<foot-bot id="f{k}"><body position="{x},{y},0" orientation="0,0,0"/>
<controller config="ahead"/></foot-bot>
"""


def built() -> Path | None:
    """The folder of a build of ARGoS with its tests, if there is one."""
    program = shutil.which("argos3")
    stated = os.environ.get("ARGOS_BUILD") or (program and Path(program).resolve().parent.parent)
    return Path(stated) if stated and (Path(stated) / _CONTROLLER).is_dir() else None


def crowd(build: Path, controller: Path, count: int, seconds: float) -> tuple[float, float]:
    """The CPU seconds of a run of ARGoS with its start, and its memory in MiB."""
    side = math.ceil(math.sqrt(count))
    robots = (ROBOT.format(k=k, x=6 * (k % side), y=6 * (k // side)) for k in range(count))
    text = EXPERIMENT.format(
        seconds=seconds,
        controller=controller.with_suffix(""),
        wide=12 * side + 20,
        middle=3 * side,
        robots="".join(robots),
    )
    with tempfile.NamedTemporaryFile("w", suffix=".argos") as file:
        file.write(text)
        file.flush()
        done = measure([str(build / "core/argos3"), "-c", file.name, "-z"], timeout_s=900.0)
    if done.code != 0:
        raise RuntimeError(f"ARGoS: {done.output[-2000:]}{done.errors[-2000:]}")
    return done.cpu_s, done.peak_mib


def argos(report: Report) -> None:
    """Robots of ARGoS, if there is a build of it: the start is measured by itself, and left out."""
    build = built()
    if build is None:
        note("ARGoS is left out: ARGOS_BUILD names no build of it, nor is argos3 of one in PATH")
        return
    table = report.table(
        "ARGoS, robots that drive ahead",
        Column("count", "robots", 0),
        Column("seconds", "s simulated", 0),
        Column("cpu_s", "CPU s"),
        Column("times_real", "× real time", 1),
        Column("start_s", "start CPU s"),
        Column("peak_mib", "MiB", 0),
    )
    (controller,) = (build / _CONTROLLER).glob("lib*controller*")
    libraries = {str(found.parent) for found in build.rglob("*.so")}
    plugins = (place for place in libraries if "/testing/" not in place)
    os.environ["ARGOS_PLUGIN_PATH"] = ":".join(sorted(plugins))
    os.environ["LD_LIBRARY_PATH"] = ":".join(sorted(libraries))
    for count, seconds in CROWDS:
        if report.quick and count > 100:
            continue
        note(f"ARGoS, {count} robots")
        start_s, _ = crowd(build, controller, count, 0.1)
        cpu_s, peak_mib = crowd(build, controller, count, seconds)
        cpu_s = max(cpu_s - start_s, 1e-3)
        row: dict[str, Cell] = {"count": count, "seconds": seconds, "cpu_s": cpu_s}
        table.rows.append(
            row | {"times_real": seconds / cpu_s, "start_s": start_s, "peak_mib": peak_mib}
        )


def measured(report: Report) -> None:
    """Both, with machine code in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["KOORD_CACHE"] = folder
        fleets(report)
    argos(report)


if __name__ == "__main__":
    sys.exit(main("simulated", __doc__, measured))
