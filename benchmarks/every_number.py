"""``koord verify --robots any`` beside mypyvy's UPDR: invariants for every number of robots.

Both are asked for an inductive invariant that shows the same claims, and given nothing else. mypyvy
is found by ``MYPYVY``, the folder of a checkout of it, and run by ``MYPYVY_PYTHON`` (else by this
Python), which needs what its ``requirements.txt`` says; models that its checkout lacks stand in
``programs/``. Wanted is at most twice its time of CPU (*ratio* is ours over its). Models differ in
what people chose to model: its actions are single assignments in any order, koord's robots take
turns in rounds; a ticket is a number here, and an element of an order there.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from msgspec import Struct

from harness import BENCHMARKS, EXAMPLES, Cell, Column, Measured, Report, koord, main, measure, note

PROTOCOLS = EXAMPLES / "protocols"
PATIENCE_S = 120.0
QUICK_S = 30.0

#: At most so many times mypyvy's seconds of CPU are wanted.
WANTED = 2.0

INVARIANT = "invariant"


class Row(Struct, frozen=True):
    """A protocol, the model of mypyvy's that is nearest to it, and the claims that both show."""

    program: str
    model: str
    claims: tuple[str, ...] = ()  #: none are all
    robots: str = "any"


ROWS = (
    Row("lock_server", "lock_server", ("Exclusive",)),
    Row("lockserv", "examples/lockserv", ("Exclusive",)),
    Row("claim", "claim"),
    Row("two_phase_commit", "two_phase_commit", ("Agree", "Unanimous")),
    Row("ticket", "examples/ticket", ("Exclusive", "Waits")),
    Row("peterson", "examples/peterson", robots="2"),
    Row("sharded_store", "examples/sharded_kv"),
    Row("ring_election", "examples/ring_leader_election"),
)


def own_answer(row: Row, patience_s: float) -> tuple[Measured, str, int]:
    """Koord's answer in words, and how many invariants it found."""
    words = ["verify", str(PROTOCOLS / f"{row.program}.krd"), "--robots", row.robots, "--json"]
    words += ["--timeout", str(patience_s)]
    words += [word for claim in row.claims for word in ("--property", claim)]
    done = koord(*words, timeout_s=patience_s + 30)
    found = done.report()
    if found is None:
        return done, done.errors.strip()[-120:] or "gave up", 0
    claims = found["claims"]
    proved = [c for c in claims if c["outcome"] == "holds" and c["all_rounds"]]
    answer = INVARIANT if len(proved) == len(claims) else f"{len(proved)} of {len(claims)} claims"
    return done, answer, len(found["found_invariants"])


def peers_answer(row: Row, patience_s: float) -> tuple[Measured | None, str]:
    """Mypyvy's answer in words; None if it is not there."""
    folder = os.environ.get("MYPYVY")
    if folder is None:
        return None, "no mypyvy"
    near = BENCHMARKS / "programs" / f"{row.model}.pyv"
    model = near if near.is_file() else Path(folder, f"{row.model}.pyv")
    python = os.environ.get("MYPYVY_PYTHON", sys.executable)
    command = [python, str(Path(folder, "src", "mypyvy.py")), "updr", str(model)]
    done = measure(command, timeout_s=patience_s)
    if done.timed_out:
        return done, "gave up"
    if "updr found inductive invariant!" in done.output:
        return done, INVARIANT
    return done, (done.output.strip().splitlines() or [done.errors.strip()])[-1][-120:]


def every_number(report: Report) -> None:
    patience_s = QUICK_S if report.quick else PATIENCE_S
    table = report.table(
        "An invariant for every number of robots, found",
        Column("program", "program"),
        Column("robots", "robots"),
        Column("koord", "koord"),
        Column("lemmas", "lemmas"),
        Column("koord_cpu_s", "CPU s", 2),
        Column("peer", "mypyvy"),
        Column("peer_cpu_s", "CPU s", 2),
        Column("ratio", "ratio", 2),
        Column("met", "met"),
    )
    for row in ROWS:
        note(row.program)
        own, answer, lemmas = own_answer(row, patience_s)
        peer, told = peers_answer(row, patience_s)
        cells: dict[str, Cell] = {
            "program": row.program,
            "robots": row.robots,
            "koord": answer,
            "lemmas": lemmas,
            "koord_cpu_s": round(own.cpu_s, 3),
            "peer": told,
        }
        report.expect(own.code in (0, 3), f"{row.program}: exit code {own.code}, {answer}")
        if peer is not None:
            ratio = own.cpu_s / peer.cpu_s
            cells |= {
                "peer_cpu_s": round(peer.cpu_s, 3),
                "ratio": round(ratio, 3),
                "met": answer == INVARIANT and ratio <= WANTED,
            }
        table.rows.append(cells)


if __name__ == "__main__":
    sys.exit(main("every_number", __doc__ or "", every_number))
