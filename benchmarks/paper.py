"""The figures of the CyPhyHouse paper beside ours: Task, and Lineform and Shapeform by processes.

*Task*, 20 places, for 1 to 4 robots and 30 seeds each: when the last place was visited (paper,
section VII), by vehicles whose speeds specs/examples/task.yaml says and the paper does not.
*Lineform* and *Shapeform* with a process for each robot, over UDP, whose drones are simulated in
real time (section V; `koord deploy --all-local --dry-run`): datagrams and bytes that each robot
sends and receives in a second, rounds in which somebody was late, and CPU, memory and threads of
all processes together, the most of what was there at a time. The same in one process, as fast as it
goes: how much quicker than the wall time passes (the real-time factor).

The paper gives some figures in words and the others as curves without numbers: that of 16 drones
there are 1,600 threads, that packets and bytes received by a robot grow linearly with the number
of robots, since every robot sends each update to every other, and that the real-time factor falls.
Its machine had 32 cores. Memory is what is resident, shared pages counted once a process.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness import EXAMPLES, LIMITS, Cell, Column, Report, koord, limited, main, note

#: Robots of Task, and the seconds that the paper's runs took; None: it does not say.
TASK: tuple[tuple[int, float | None], ...] = ((1, None), (2, None), (3, 110.0), (4, 90.0))

#: A run of Task may take so much CPU.
TASK_S = 8.0

#: Programs with a process for each robot, and how many.
SPREAD: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("lineform", (2, 4, 8, 16)),
    ("shapeform", (9, 16)),
)

#: Drones stand in two rows, in their order along x: over so many metres, or where those are many
#: over more, so that so much is between one and the next.
_WIDE_M, _LEAST_M = 18.0, 1.0

#: Robots of Lineform in one process.
TOGETHER = (4, 16, 64, 256, 1_024)

#: Of 16 drones the paper's simulator has so many threads.
PAPER_THREADS = {16: 1_600}

#: Seconds of a run, and of a round.
RUN_S, _DELTA_S = 20.0, 0.1

#: What each robot tells of its messages.
_TRAFFIC = ("sent", "arrived", "sent_bytes", "arrived_bytes")

#: Between two looks at the processes of a run.
_LOOK_S = 0.2

_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Sampled:
    """A run of koord, and what its processes had while it went on."""

    code: int
    wall_s: float
    cpu_s: float
    output: str
    errors: str
    threads: list[int] = field(default_factory=list)
    memory_mib: list[float] = field(default_factory=list)


def sampled(*arguments: str) -> Sampled:
    """Run koord, and look at its processes meanwhile."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        began = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, "-m", "koord", *arguments],
            stdout=output,
            stderr=errors,
            start_new_session=True,
        )
        made = Sampled(0, 0.0, 0.0, "", "")
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                break
            threads, memory_mib = _session(child.pid)
            if threads:
                made.threads.append(threads)
                made.memory_mib.append(memory_mib)
            time.sleep(_LOOK_S)
        made.wall_s = time.perf_counter() - began
        made.code = child.returncode = os.waitstatus_to_exitcode(status)
        made.cpu_s = usage.ru_utime + usage.ru_stime
        for file, name in ((output, "output"), (errors, "errors")):
            file.seek(0)
            setattr(made, name, file.read().decode("utf-8", "replace"))
    return made


def _session(leader: int) -> tuple[int, float]:
    """Threads and resident MiB of all processes of a session."""
    threads, pages = 0, 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = path.read_text("utf-8").rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        if int(words[3]) == leader:  # words[0] is the state, the third field of stat
            threads += int(words[17])
            pages += int(words[21])
    return threads, pages * _PAGE / 2**20


# --- Task -----------------------------------------------------------------------------------------


def task(report: Report) -> None:
    """Task, for 1 to 4 robots, over seeds."""
    table = report.table(
        "Task: 20 places in the arena of 7 × 8 × 3 m, until the last is visited",
        Column("robots", "robots", 0),
        Column("runs", "runs", 0),
        Column("done", "all visited", 0),
        Column("mean_s", "mean s", 1),
        Column("spread_s", "± s (95 %)", 1),
        Column("least_s", "least s", 1),
        Column("most_s", "most s", 1),
        Column("paper_s", "paper s", 0),
        Column("nearest_m", "nearest m"),
        Column("safety_m", "safe m"),
        Column("broken", "broken", 0),
        Column("packets", "packets received, a robot and s", 1),
        Column("bytes", "bytes", 0),
        Column("cpu_s", "CPU s a run"),
        Column("factor", "× real time", 1),
        Column("memory_mib", "MiB", 0),
        Column("threads", "threads", 0),
        *LIMITS,
    )
    runs = 3 if report.quick else 30
    means: dict[int, float] = {}
    for robots, paper_s in TASK:
        name = f"Task, {robots} robots"
        note(f"{name}, {runs} seeds")
        jobs = str(os.cpu_count() or 1)
        flags = ["--robots", str(robots), "--runs", str(runs), "--jobs", jobs, "--json"]
        done = koord("sim", str(EXAMPLES / "task.krd"), *flags, timeout_s=3_000.0)
        found = done.json()
        if not report.expect(found is not None, f"{name}: {done.errors[-500:]}"):
            continue
        times = [run["tasks_s"] for run in found["runs"] if run["tasks_s"] is not None]
        whole = sum(run["tasks_done"] == run["tasks"] == 20 for run in found["runs"])
        # That a clear way to the last place is found is assumed: a robot that rests may be in it.
        report.expect(whole > runs // 2, f"{name}: {runs - whole} runs left tasks")
        broken = sum(run["broken"] for run in found["runs"])
        report.expect(broken == 0, f"{name}: {broken} claims broken")
        cpu_s = done.cpu_s / runs
        row: dict[str, Cell] = {"robots": robots, "runs": runs, "done": whole, "paper_s": paper_s}
        row |= {"broken": broken, "cpu_s": cpu_s, **limited(cpu_s, TASK_S, "s CPU")}
        row |= _needed(found["runs"], robots)
        if times:
            means[robots], row["spread_s"] = _interval(times)
            row |= {"mean_s": means[robots], "least_s": min(times), "most_s": max(times)}
        if robots > 1:
            nearest = min(run["separation_m"] for run in found["runs"])
            safety = max(run["safety_m"] for run in found["runs"])
            report.expect(nearest > safety, f"{name}: {nearest:.2f} m apart")
            row |= {"nearest_m": nearest, "safety_m": safety}
        table.rows.append(row)
    if {3, 4} <= set(means) and not report.quick:
        report.expect(means[4] < means[3], "Task: 4 robots are not quicker than 3")


def _needed(runs: Sequence[dict[str, Any]], robots: int) -> dict[str, Cell]:
    """What runs sent and needed; memory and threads are those of the process that made them."""
    time_s = sum(run["time_s"] for run in runs)
    return {
        "packets": sum(run["packets_received"] for run in runs) / robots / time_s,
        "bytes": sum(run["bytes_received"] for run in runs) / robots / time_s,
        "factor": time_s / sum(run["wall_s"] for run in runs),
        "memory_mib": max(run["memory_mib"] for run in runs),
        "threads": max(run["threads"] for run in runs),
    }


def _interval(values: Sequence[float]) -> tuple[float, float]:
    """The mean, and about how far its interval of 95 % reaches."""
    mean = sum(values) / len(values)
    variance = sum((value - mean) ** 2 for value in values) / max(1, len(values) - 1)
    return mean, 2 * math.sqrt(variance / len(values))


# --- Lineform and Shapeform -----------------------------------------------------------------------

RESOURCES = (
    Column("factor", "× real time", 1),
    Column("cpu", "CPU %", 0),
    Column("memory_mib", "MiB", 0),
    Column("threads", "threads", 0),
    Column("paper_threads", "paper: threads", 0),
)


def spread(report: Report) -> None:
    """A process for each robot: what each sends and receives, and what all of them need."""
    table = report.table(
        "A process for each robot, over UDP, in real time: a robot and second",
        Column("program", "program"),
        Column("robots", "robots", 0),
        Column("sent", "datagrams sent", 1),
        Column("arrived", "received", 1),
        Column("busiest", "by the coordinator", 1),
        Column("sent_bytes", "bytes sent", 0),
        Column("arrived_bytes", "received", 0),
        Column("late", "late, % of robot-rounds", 2),
        *RESOURCES,
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, sizes in SPREAD[:1] if report.quick else SPREAD:
            for robots in sizes[:2] if report.quick else sizes:
                note(f"{name}, {robots} processes")
                row = _deployed(report, name, robots, Path(folder))
                if row is not None:
                    table.rows.append(row)


def _deployed(report: Report, name: str, robots: int, folder: Path) -> dict[str, Cell] | None:
    """The row of a run with a process for each robot."""
    config = folder / f"{name}{robots}.yaml"
    config.write_text(_configuration(name, robots), "utf-8")
    rounds = round((3.0 if report.quick else RUN_S) / _DELTA_S)
    flags = ["--all-local", "--dry-run", "--json", "--rounds", str(rounds)]
    made = sampled("deploy", str(EXAMPLES / f"{name}.krd"), str(config), *flags)
    told = f"{name}, {robots} processes: code {made.code}, {made.errors[-300:]}"
    if not report.expect(made.output.startswith("{"), told):
        return None
    found: list[dict[str, Any]] = json.loads(made.output)["robots"]
    report.expect(all(one["arrived_bytes"] > 0 for one in found), f"{name}: nothing was heard")
    time_s = max(one["took_s"] for one in found)
    return {
        "program": name,
        "robots": robots,
        **{key: sum(one[key] for one in found) / robots / time_s for key in _TRAFFIC},
        "busiest": max(one["arrived"] for one in found) / time_s,
        "late": 100 * sum(one["late"] for one in found) / robots / rounds,
        **_resources(made, found[0]["round"] * _DELTA_S / time_s, robots),
    }


def _configuration(name: str, robots: int) -> str:
    """Drones along x where the program begins anywhere; those of the example where it does not."""
    if name == "shapeform":
        return (EXAMPLES / f"shapeform{'' if robots == 16 else f'_{robots}'}.yaml").read_text(
            "utf-8"
        )
    half = _half_m(robots)
    apart = 2 * half / (robots - 1)
    places = (f"[{apart * k - half:.3f}, {2 * (k % 2)}, 1.5]" for k in range(robots))
    at = ", ".join(f"{k}: {place}" for k, place in enumerate(places))
    device = "device: {bot_name: drone, bot_type: QUAD, planner: STRAIGHT}"
    arena = f"world: {{bounds: {{low: [{-half - 1}, -10, 0], high: [{half + 1}, 10, 4]}}}}"
    return f"delta: {_DELTA_S}\nnum_robots: {robots}\n{device}\npositions: {{{at}}}\n{arena}\n"


def _half_m(robots: int) -> float:
    """How far from the middle the first and the last of drones along x are."""
    return max(_WIDE_M, _LEAST_M * (robots - 1)) / 2


def _program(name: str, robots: int) -> str:
    """The text of an example, whose box is as wide as the arena."""
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    wide = text.replace("pos(-10.0, ", f"pos({-_half_m(robots) - 1}, ")
    return wide.replace("pos(10.0, ", f"pos({_half_m(robots) + 1}, ")


def together(report: Report) -> None:
    """All robots in one process: what that needs."""
    table = report.table(
        "All robots in one process",
        Column("program", "program"),
        Column("robots", "robots", 0),
        *RESOURCES,
    )
    with tempfile.TemporaryDirectory() as folder:
        for robots in TOGETHER[:2] if report.quick else TOGETHER:
            note(f"lineform, {robots} robots")
            made, found = _run(report, "lineform", robots, Path(folder))
            if found is not None:
                row: dict[str, Cell] = {"program": "lineform", "robots": robots}
                factor = found["time_s"] / found["wall_s"]
                table.rows.append({**row, **_resources(made, factor, robots)})


def _run(
    report: Report, name: str, robots: int, folder: Path
) -> tuple[Sampled, dict[str, Any] | None]:
    """A run in one process; None if it did not come to its end."""
    config = folder / f"{name}{robots}.yaml"
    config.write_text(_configuration(name, robots), "utf-8")
    program = folder / f"{name}{robots}.krd"
    program.write_text(_program(name, robots), "utf-8")
    time_s = 3.0 if report.quick else RUN_S
    told = ["--time", str(time_s), "--no-html", "--json", "--keep-going"]
    made = sampled("sim", str(program), str(config), *told)
    found = json.loads(made.output) if made.output.startswith("{") else {}
    story = f"{name}, {robots} robots: {made.code}, {made.output[-300:]}{made.errors[-300:]}"
    return made, found if report.expect(found.get("format") == "koord-simulated", story) else None


def _resources(made: Sampled, factor: float, robots: int) -> dict[str, Cell]:
    return {
        "factor": factor,
        "cpu": 100 * made.cpu_s / made.wall_s,
        "memory_mib": max(made.memory_mib, default=None),
        "threads": max(made.threads, default=None),
        "paper_threads": PAPER_THREADS.get(robots),
    }


def benchmark(report: Report) -> None:
    task(report)
    spread(report)
    together(report)


if __name__ == "__main__":
    sys.exit(main("paper", __doc__ or "", benchmark))
