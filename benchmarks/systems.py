"""The examples of other systems: what is proved of each, and what each does in simulation.

Those that the paper compares with in its table 1 (docs/systems.md). *Proved* is how many claims
hold in every round, of how many; *least* how near two robots come to each other, of their middles.
"""

from __future__ import annotations

import sys
from pathlib import Path

from harness import EXAMPLES, Cell, Column, Report, koord, main, note

SYSTEMS = EXAMPLES / "systems"

#: Programs that are examples already, and do what another system is known for.
OLDER = (EXAMPLES / "delivery.krd", EXAMPLES / "mapping.krd")

#: A simulated run ends after so many seconds, if it does not by itself; in `--quick` ones, too.
RUN_S, QUICK_S = 60.0, 10.0


def configurations(program: Path) -> list[Path]:
    """The configurations of an example: those that begin with its name."""
    return sorted(program.parent.glob(f"{program.stem}*.yaml"))


def systems(report: Report) -> None:
    """Two tables: verdicts, and runs."""
    proved = report.table(
        "Proved",
        Column("program", "program"),
        Column("robots", "robots"),
        Column("claims", "claims"),
        Column("proved", "proved"),
        Column("cpu_s", "CPU s", 1),
    )
    run = report.table(
        "Simulated",
        Column("configuration", "configuration"),
        Column("time_s", "time s", 1),
        Column("way_m", "way m", 1),
        Column("least_m", "least m"),
        Column("ending", "ended"),
        Column("cpu_s", "CPU s", 1),
    )
    time_s = QUICK_S if report.quick else RUN_S
    for program in (*sorted(SYSTEMS.glob("*.krd")), *OLDER):
        note(program.stem)
        done = koord("verify", str(program), "--json", timeout_s=300)
        found = done.report()
        if report.expect(done.code == 0 and found is not None, f"{program.stem}: {done.code}"):
            claims = found["claims"]
            holds = sum(one["outcome"] == "holds" and one["all_rounds"] for one in claims)
            cells: dict[str, Cell] = {"program": program.stem, "robots": found["robots"]}
            cells |= {"claims": len(claims), "proved": holds, "cpu_s": round(done.cpu_s, 1)}
            proved.rows.append(cells)
        for file in configurations(program):
            words = ["sim", str(program), str(file), "--no-html", "--json", "--time", str(time_s)]
            done = koord(*words, timeout_s=600)
            told = done.json()
            if report.expect(told is not None and done.code == 0, f"{file.stem}: {done.code}"):
                near, way_m = told["nearest"], sum(one["distance_m"] for one in told["robots"])
                cells = {"configuration": file.stem, "time_s": told["time_s"], "way_m": way_m}
                cells |= {"least_m": None if near is None else near["distance_m"]}
                cells["ending"] = told["ending"]
                run.rows.append(cells | {"cpu_s": round(done.cpu_s, 1)})


if __name__ == "__main__":
    sys.exit(main("systems", __doc__, systems))
