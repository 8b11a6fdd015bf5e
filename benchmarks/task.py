"""``koord verify specs/examples/task.krd --rounds 20`` for more and more robots and tasks.

The limits are of the clock on the wall, start-up included: 10 s for 3 robots and 4 tasks, 60 s for
10 robots and 10 tasks.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from harness import (
    EXAMPLES,
    LIMITS,
    TIMES,
    Column,
    Measured,
    Report,
    gave_up,
    koord,
    limited,
    main,
    note,
    times,
)

TASK = str(EXAMPLES / "task.krd")
ROUNDS = 20

#: Robots, tasks, and the limit in seconds if there is one.
SIZES: tuple[tuple[int, int, float | None], ...] = (
    (2, 4, None),
    (3, 4, 10.0),
    (4, 5, None),
    (5, 6, None),
    (6, 8, None),
    (8, 8, None),
    (10, 10, 60.0),
    (12, 10, None),
)

#: What one engine alone makes of the first of the two sizes.
ENGINES = ("induction", "bmc")

#: What every engine can answer; liveness is for some.
SAFETY = ("Holds", "Exclusive", "Route", "Along", "Clearance", "no fault")

#: When a run without a limit of its own is given up.
PATIENCE_S = 120.0


def verified(robots: int, tasks: int, *flags: str, timeout_s: float) -> Measured:
    """One run. The timeout asks koord to stop; a while later it is made to."""
    return koord(
        *("verify", TASK, "--rounds", str(ROUNDS), "--robots", str(robots)),
        *("--set", f"tasks={tasks}", "--timeout", str(timeout_s), "--json", *flags),
        timeout_s=timeout_s + 30,
    )


def reach(found: Any) -> str:
    """How far the verdict reaches, and by which engines."""
    if found is None:
        return "given up"
    claims = found["claims"]
    engines = ", ".join(sorted({claim["engine"] for claim in claims}))
    if found["outcome"] == "holds":
        everywhere = all(claim["all_rounds"] for claim in claims)
        rounds = "every round" if everywhere else f"{ROUNDS} rounds"
    else:
        rounds = f"{min(claim['through_round'] or 0 for claim in claims)} rounds"
    return f"{rounds}, {engines}"


def task(report: Report) -> None:
    columns = (
        Column("robots", "robots"),
        Column("tasks", "tasks"),
        Column("outcome", "verdict"),
        Column("reach", "how far, by what"),
        *TIMES,
    )
    by_size = report.table(f"task.krd, --rounds {ROUNDS}", *columns, *LIMITS)
    sizes = SIZES[:4] if report.quick else SIZES
    for robots, tasks, limit_s in sizes:
        note(f"{robots} robots, {tasks} tasks")
        done = verified(robots, tasks, timeout_s=limit_s * 4 if limit_s else PATIENCE_S)
        outcome = judged(report, f"{robots} × {tasks}", done)
        by_size.rows.append(
            {
                "robots": robots,
                "tasks": tasks,
                "outcome": outcome,
                "reach": reach(done.report()),
                **times(done),
                **limited(done.wall_s if outcome == "holds" else math.inf, limit_s),
            }
        )
    by_engine = report.table(
        f"task.krd, --rounds {ROUNDS}, by one engine", Column("engine", "engine"), *columns
    )
    for engine in ENGINES:
        note(f"--engine {engine}")
        asked = [word for name in SAFETY for word in ("--property", name)]
        patience_s = 30 if report.quick else 60
        done = verified(3, 4, "--engine", engine, *asked, timeout_s=patience_s)
        by_engine.rows.append(
            {
                "engine": engine,
                "robots": 3,
                "tasks": 4,
                "outcome": judged(report, engine, done),
                "reach": reach(done.report()),
                **times(done),
            }
        )


def judged(report: Report, what: str, done: Measured) -> str:
    """The verdict; it is to hold, unless there was not enough time."""
    found = done.report()
    outcome = "unknown" if found is None else str(found["outcome"])
    right = outcome == "holds" or gave_up(done)
    report.expect(right, f"{what}: {outcome}, exit code {done.code}, {done.errors[-300:]}")
    return outcome


if __name__ == "__main__":
    sys.exit(main("task", __doc__ or "", task))
