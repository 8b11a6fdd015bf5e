"""``koord verify --cluster``: what workers of a Dask cluster are good for, and what they cost.

The cluster is on this machine, with as many workers as the heading says, so that with more of them
than cores nothing is gained: a real one has cores of its own. *Wall* is that of the whole command,
and *CPU* is that of this command and, apart from it, of the cluster from its start to its end (the
scheduler's and the workers' own, of an *idle* one, stands in the first row). Verdicts must be the
same as without one.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from harness import EXAMPLES, NOTHING, ROOT, Column, Measured, Report, koord, main, note

PATIENCE_S = 300.0

#: So many workers are asked.
WORKERS = (1, 2)

#: A scheduler and workers, which end when nobody listens any more.
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=int(sys.argv[1]), threads_per_worker=1, dashboard_address=":0",
                      silence_logs=50) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


@dataclass(frozen=True)
class Question:
    """A command, and its exit code. ``what`` is asked of workers."""

    what: str
    file: str
    flags: str
    code: int = 0

    @property
    def words(self) -> list[str]:
        return [str(EXAMPLES / f"{self.file}.krd"), *self.flags.split()]


QUESTIONS = (
    Question("nothing, it is quick", "leader_elect", "--robots 3"),
    Question("numbers of robots", "sum_of_ids", "--robots 2..5"),
    Question("claims and cubes", "task", "--engine bmc --robots 3 --rounds 5", 3),
)


@dataclass
class Cluster:
    """A cluster at an address; what it took stands there when it has ended."""

    address: str
    cpu_s: float = field(default=0.0)


@contextmanager
def cluster_of(workers: int) -> Iterator[Cluster]:
    process = subprocess.Popen(
        [sys.executable, "-c", CLUSTER, str(workers)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=ROOT,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    found = Cluster(process.stdout.readline().strip())
    try:
        yield found
    finally:
        process.stdin.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        found.cpu_s = usage.ru_utime + usage.ru_stime


def asked(question: Question, *more: str) -> Measured:
    return koord("verify", *question.words, *more, "--json", timeout_s=PATIENCE_S)


def verdicts(found: Any) -> list[tuple[object, ...]]:
    """What is said of claims: for a violation another run may be shown."""
    said = ("name", "outcome", "engine", "all_rounds", "through_round", "every_number_of_robots")
    reports = found["reports"]
    return [tuple(claim[key] for key in said) for each in reports for claim in each["claims"]]


def cluster(report: Report) -> None:
    table = report.table(
        f"--cluster on this machine beside none ({os.cpu_count()} cores)",
        Column("what", "asked of workers"),
        Column("program", "program"),
        Column("flags", "flags"),
        Column("workers", "workers"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s here"),
        Column("there_s", "CPU s there"),
        Column("load", "load", 1),
    )
    with cluster_of(WORKERS[-1]) as idle:
        pass
    table.rows.append(
        {
            "what": "idle",
            "program": NOTHING,
            "flags": NOTHING,
            "workers": WORKERS[-1],
            "wall_s": NOTHING,
            "cpu_s": NOTHING,
            "there_s": round(idle.cpu_s, 2),
            "load": NOTHING,
        }
    )
    for question in QUESTIONS[:1] if report.quick else QUESTIONS:
        alone: Any = None
        for workers in (None, *WORKERS):
            note(f"{question.file} {question.flags}, {workers or 'no'} workers")
            there_s: float | None = None
            if workers is None:
                done = asked(question)
            else:
                with cluster_of(workers) as found:
                    done = asked(question, "--cluster", found.address)
                there_s = round(found.cpu_s, 2)
            story = f"{question.file} {question.flags}, {workers} workers: "
            report.expect(
                done.code == question.code, f"{story}{done.code} {done.errors.strip()[-300:]}"
            )
            alone = alone or done.json()
            report.expect(
                alone is not None and verdicts(done.json()) == verdicts(alone),
                f"{story}verdicts differ",
            )
            table.rows.append(
                {
                    "what": question.what,
                    "program": question.file,
                    "flags": question.flags,
                    "workers": NOTHING if workers is None else workers,
                    "wall_s": round(done.wall_s, 2),
                    "cpu_s": round(done.cpu_s, 2),
                    "there_s": NOTHING if there_s is None else there_s,
                    "load": round(os.getloadavg()[0], 1),
                }
            )


if __name__ == "__main__":
    sys.exit(main("cluster", __doc__ or "", cluster))
