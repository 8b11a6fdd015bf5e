"""Buzz beside koord: four applications of swarms, on the same places, with the same range.

Buzz is not part of this project: ``BUZZ`` is the folder where ARGoS 3 and Buzz (NESTLab/Buzz) were
installed, with ``bin/argos3`` and ``bin/bzzc`` in it. Without it its rows say *not there*.

The applications are specs/examples/systems/buzz_*.krd and, for Buzz, benchmarks/programs/buzz: the
same laws in own words. Both have the places, δ and range of koord's configurations. Drones are
ARGoS's eye-bots; what goes on two wheels are its foot-bots, told to go as fast as koord's; robots
that only talk are eye-bots that stand. Runs of both are judged alike, by where robots are and what
they say that they know, after each round: *rounds* is how many it took until the greatest value was
known to all, all had passed the barrier, or each half of the swarm knew who leads it; *there* is
from when on the seven drones are 10 cm, and the halves of the swarm 30 cm, from where they end;
*edges* are the distances of neighbours (less than 2.7 m apart) in the hexagon at the end.

CPU is that of a run of a minute without its start, which is measured by itself of ARGoS. It is told
of those who move: koord's runs end where nothing changes any more.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from harness import BENCHMARKS, EXAMPLES, Cell, Column, Report, in_child, main, measure, note

PROGRAMS = BENCHMARKS / "programs" / "buzz"

#: Applications, and within how many metres of where it ends a robot is said to be there.
APPLICATIONS = {"hexagon": 0.1, "maximum": 0.0, "barrier": 0.0, "split": 0.3}

RUN_S, QUICK_S = 60.0, 20.0

#: Neighbours in the hexagon are nearer than the second ring, which is 1.7 edges away.
NEIGHBOURS_M = 2.7

#: What a robot says at the end: the greatest value; that it has passed; who leads its half.
WANTED = {"maximum": [8.0] * 5, "barrier": [1.0] * 4, "split": [0.0, 1.0] * 3}

EXPERIMENT = """\
<?xml version="1.0" ?>
<argos-configuration>
<framework><system threads="0"/>
<experiment length="{seconds}" ticks_per_second="{ticks}" random_seed="1"/></framework>
<controllers><buzz_controller_{kind} library="{library}" id="swarm">
<actuators><{moves} implementation="default"/>
<range_and_bearing implementation="default"/></actuators>
<sensors><range_and_bearing implementation="medium" medium="radio" show_rays="false"/>
<positioning implementation="default"/></sensors>
<params bytecode_file="{code}" debug_file="{debug}">
<wheel_turning max_speed="{speed}" hard_turn_angle_threshold="90" soft_turn_angle_threshold="70"
 no_turn_angle_threshold="10"/></params>
</buzz_controller_{kind}></controllers>
<arena size="40,40,8" center="0,0,2">{robots}</arena>
<physics_engines><{physics} id="physics"/></physics_engines>
<media><range_and_bearing id="radio"/></media>
</argos-configuration>
"""

ROBOT = """\
<{kind} id="r{pid}" rab_range="{range}" rab_data_size="500">
<body position="{x},{y},{z}" orientation="0,0,0"/><controller config="swarm"/></{kind}>
"""


def _example(name: str) -> Path:
    return EXAMPLES / "systems" / f"buzz_{name}.krd"


def _setting(name: str) -> dict[str, Any]:
    """The configuration of an example, as it is written."""
    import yaml

    told: dict[str, Any] = yaml.safe_load(_example(name).with_suffix(".yaml").read_text("utf-8"))
    return told


# --- runs -----------------------------------------------------------------------------------------


def ours(name: str, time_s: float) -> dict[str, Any]:
    """Where koord's robots are after each round, and what they say; in a process of its own."""
    import time

    from koord.api.fitting import fit, fit_request
    from koord.api.sim_setup import simulation
    from koord.sim.running import Simulation, run

    file = _example(name)

    def begun() -> Simulation:
        request = fit_request(file, file.with_suffix(".yaml"), None, None, None, None)
        made = simulation(fit(request), Simulation)
        made.begin()
        return made

    def told(made: Simulation) -> list[float]:
        robots, shared = made.engine.robots, made.engine.store.values
        if name == "barrier":
            return [float(vars(robot)["passed"]) for robot in robots]
        return [float(value) for value in shared.get("best", shared.get("leader", ()))]

    made, delta_s = begun(), _setting(name)["delta"]
    places, said = [made.fleet.positions()[:, :2].tolist()], [told(made)]
    for _ in range(round(time_s / delta_s)):
        made.round()
        places.append(made.fleet.positions()[:, :2].tolist())
        said.append(told(made))
    again = begun()  # what is loaded and compiled once is there
    began_s = time.process_time()
    list(run(again, time_s))
    factor = again.time_s / (time.process_time() - began_s)
    return {"factor": factor, "delta_s": delta_s, "places": places, "said": said}


def theirs(buzz: Path, name: str, time_s: float) -> dict[str, Any]:
    """The same of Buzz's robots in ARGoS. Raises RuntimeError if it does not run."""
    from koord.runtime.motion.bodies import DifferentialDrive

    told = _setting(name)
    on_wheels = name == "split"
    kind = "foot-bot" if on_wheels else "eye-bot"
    robots = "".join(
        ROBOT.format(kind=kind, pid=pid, range=told["radio"]["range"], x=x, y=y, z=z)
        for pid, (x, y, z) in ((pid, [*at, 0][:3]) for pid, at in told["positions"].items())
    )
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        code, debug = folder / "program.bo", folder / "program.bdb"
        _run(buzz, "bzzc", "-b", str(code), "-d", str(debug), str(PROGRAMS / f"{name}.bzz"))

        def run(seconds: float) -> tuple[float, str]:
            text = EXPERIMENT.format(
                seconds=seconds,
                ticks=round(1 / told["delta"]),
                kind=kind.replace("-", ""),
                library=buzz / "lib/argos3/libargos3plugin_simulator_buzz",
                moves="differential_steering" if on_wheels else "quadrotor_position",
                code=code,
                debug=debug,
                speed=100 * DifferentialDrive().cruise_mps,
                robots=robots,
                physics="dynamics2d" if on_wheels else "pointmass3d",
            )
            (folder / "it.argos").write_text(text, "utf-8")
            return _run(buzz, "argos3", "-c", str(folder / "it.argos"), "-z", "-n")

        start_s, _ = run(told["delta"])
        cpu_s, output = run(time_s)
    places, said = _heard(output, len(told["positions"]))
    return {
        "factor": time_s / max(0.01, cpu_s - start_s),
        "delta_s": told["delta"],
        "places": places,
        "said": said,
    }


def _run(buzz: Path, program: str, *words: str) -> tuple[float, str]:
    """CPU seconds and output of a program of the installation."""
    libraries = f"{buzz}/lib/argos3:{buzz}/lib"
    setting = (
        f"PATH={buzz}/bin:{os.environ['PATH']}",
        f"LD_LIBRARY_PATH={libraries}",
        f"ARGOS_PLUGIN_PATH={buzz}/lib/argos3",
        f"BUZZ_INCLUDE_PATH={buzz}/share/buzz/include",
    )
    done = measure(["env", *setting, program, *words], timeout_s=300.0)
    if done.code != 0:
        raise RuntimeError(f"{program}: {done.output[-1000:]}{done.errors[-1000:]}")
    return done.cpu_s, done.output


def _heard(output: str, robots: int) -> tuple[list[list[list[float]]], list[list[float]]]:
    """What robots have logged: places and values, each by round and robot.

    Nothing is known before the first round.
    """
    at: list[list[list[float]]] = [[] for _ in range(robots)]
    values: list[list[float]] = [[] for _ in range(robots)]
    for line in output.splitlines():
        match line.removeprefix("BUZZ: ").split():
            case ["at", pid, x, y]:
                at[int(pid)].append([float(x), float(y)])
            case ["knows" | "passed" | "leader", pid, value]:
                values[int(pid)].append(float(value))
    return (
        [list(row) for row in zip(*at, strict=True)],
        [[], *(list(row) for row in zip(*values, strict=True))],
    )


# --- what came of it ------------------------------------------------------------------------------


def first_of(rows: Sequence[Any], wanted: Any) -> int | None:
    """The number of the first row that is as wanted, and stays so; None if the last is not."""
    found = None
    for number in reversed(range(len(rows))):
        if rows[number] != wanted:
            break
        found = number
    return found


def there(places: Sequence[Sequence[Sequence[float]]], near_m: float) -> int:
    """From which row on each robot is as near to where it is in the last."""
    ends = places[-1]

    def is_near(row: Sequence[Sequence[float]]) -> bool:
        return all(math.dist(a, b) <= near_m for a, b in zip(row, ends, strict=True))

    found = first_of([is_near(row) for row in places], True)
    assert found is not None  # the last is where it is
    return found


def edges(places: Sequence[Sequence[float]]) -> list[float]:
    """Distances in metres of those who are neighbours."""
    pairs = (math.dist(a, b) for i, a in enumerate(places) for b in places[:i])
    return sorted(far for far in pairs if far < NEIGHBOURS_M)


def judged(report: Report, what: str, name: str, made: dict[str, Any]) -> dict[str, Cell]:
    """The cells of a run; what is not as it should be is told to the report."""
    row: dict[str, Cell] = {}
    if name in WANTED:
        rounds = first_of(made["said"], WANTED[name])
        report.expect(rounds is not None, f"{what}: it ends with {made['said'][-1]}")
        row["rounds"] = rounds
    if near_m := APPLICATIONS[name]:
        row["there_s"] = there(made["places"], near_m) * made["delta_s"]
        row["factor"] = made["factor"]
    if name == "hexagon":
        found = edges(made["places"][-1])
        report.expect(len(found) == 12, f"{what}: {len(found)} edges")
        row |= {"least_m": found[0], "most_m": found[-1]}
    if name == "split":
        ends = made["places"][-1]
        sides = all((at[0] > 0) == (pid % 2 == 1) for pid, at in enumerate(ends))
        report.expect(sides, f"{what}: it ends at {ends}")
    return row


def buzz(report: Report) -> None:
    """One table, with two rows for each application."""
    table = report.table(
        "Swarms of Buzz in ARGoS, and of koord",
        Column("application", "application"),
        Column("of", "of"),
        Column("rounds", "rounds"),
        Column("there_s", "there s", 1),
        Column("least_m", "edges from m"),
        Column("most_m", "to m"),
        Column("factor", "× real time (CPU)", 0),
    )
    time_s = QUICK_S if report.quick else RUN_S
    for name in APPLICATIONS:
        for of in ("Buzz", "koord"):
            row: dict[str, Cell] = {"application": name, "of": of}
            table.rows.append(row)
            installed = os.environ.get("BUZZ")
            if of == "Buzz" and not installed:
                row["rounds"] = "not there"
                continue
            what = f"{name}, {of}"
            note(what)
            try:
                if of == "Buzz":
                    made = theirs(Path(installed or ""), name, time_s)
                else:
                    made = in_child(ours, name, time_s, timeout_s=600.0)
            except RuntimeError as problem:
                report.expect(False, f"{what}: {problem}")
                continue
            row |= judged(report, what, name, made)


if __name__ == "__main__":
    sys.exit(main("buzz", __doc__ or "", buzz))
