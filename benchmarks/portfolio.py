"""The portfolio beside its engines: what `auto` takes, and what the best single engine takes.

Each row is a program with its robots; each engine is asked alone, and `auto`, which asks them all,
as is the default. An engine *settles* a row if it says as much of every claim as `auto` does: that
it is violated, or that it holds for as many rounds and for as many robots (where `auto` has a
proof for every number of robots, that is wanted of the engine, too). An engine alone gets as long
as `auto` took: what is slower is not the best one. Proofs for every number of robots, which
`--robots any` asks alone, are an engine as well. *Excess* is the time of `auto` beyond 1.3 times
that of the best engine and 0.3 s, on the clock and of processors: it should not be above zero.

Whoever waits may not care that `auto` says more. So the columns *for these robots* compare it with
the best engine that has an answer for the robots of the row, be it for every number or not: what
`auto` takes beyond that includes what it costs to look for the stronger answer. Where no engine
alone says as much as `auto` does (some claims are proved for every number, some are not), these
are the only ones.

The second table is about the look for what makes verdicts say less than they seem to: its part of
the CPU time that verdicts took, in one process. `KOORD_ROWS` names the rows that are wanted (a
regular expression): `KOORD_ROWS=claiming benchmarks/portfolio.py`. All of them take half an hour:
with `KOORD_KEPT=FILE` each row is written there once it is measured, and those that stand there are
not measured again, so that it can be stopped and gone on with; `KOORD_TABLES=engines` or `vacuity`
leaves out the other table.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

from harness import (
    BENCHMARKS,
    EXAMPLES,
    Cell,
    Column,
    Measured,
    Report,
    koord,
    main,
    measure,
    note,
)

#: The proofs for every number of robots, which are asked for by `--robots any`.
EVERY_N = "every N"

ENGINES = ("search", "induction", "bits", "abc", "spacer", "bmc", EVERY_N)

#: How much slower than the best engine alone `auto` may be: so many times, and so many seconds.
TIMES, SECONDS = 1.3, 0.3

#: The largest part of the proofs' time that the look for vacuity should take.
SHARE = 0.5

PATIENCE_S = 40.0
QUICK_S = 10.0

#: Robots and tasks of the claiming model.
SIZES = ((3, 4), (5, 6), (6, 8), (10, 10))


@dataclass(frozen=True)
class Asked:
    """A row: its name, and the words of the command that are not about engines."""

    name: str
    words: tuple[str, ...]


def rows() -> list[Asked]:
    """The claiming model, the examples and the protocols, as `KOORD_ROWS` wants them."""
    found = []
    claiming = BENCHMARKS / "programs" / "claiming.krd"
    lemma = ("--with", str(claiming.with_name("claiming_owned.krd")))
    for more, told in ((lemma, ", lemma"), ((), "")):
        for robots, tasks in SIZES:
            sizes = ("--robots", str(robots), "--set", f"tasks={tasks}")
            found.append(Asked(f"claiming {robots}/{tasks}{told}", (str(claiming), *sizes, *more)))
    for folder in (EXAMPLES, EXAMPLES / "protocols"):
        for path in sorted(folder.glob("*.krd")):
            found.append(Asked(str(path.relative_to(EXAMPLES)), (str(path),)))
    wanted = re.compile(os.environ.get("KOORD_ROWS", ""))
    return [row for row in found if wanted.search(row.name)]


class Kept:
    """The rows that were measured before, and are now, in a file of lines; without one, none."""

    def __init__(self) -> None:
        name = os.environ.get("KOORD_KEPT")
        self.path = Path(name) if name else None
        self.rows: dict[tuple[str, str], dict[str, Cell]] = {}
        if self.path is not None and self.path.exists():
            for line in self.path.read_text().splitlines():
                of, cells = json.loads(line)
                self.rows[of, cells["row"]] = cells

    def row(self, of: str, name: str, measured: Callable[[], dict[str, Cell]]) -> dict[str, Cell]:
        """A row of a table: as it was measured before, or now."""
        found = self.rows.get((of, name))
        if found is None:
            note(f"{of}, {name}")
            found = self.rows[of, name] = measured()
            note(str(found))
            if self.path is not None:
                with self.path.open("a") as lines:
                    lines.write(json.dumps([of, found]) + "\n")
        return found


def wants(table: str) -> bool:
    """Whether a table is wanted."""
    return os.environ.get("KOORD_TABLES", table) == table


class Said(NamedTuple):
    """What is said of a claim: for how many rounds, and whether for every number of robots."""

    outcome: str
    rounds: float
    of_every_number: bool

    def is_as_much_as(self, wanted: Said, *, of_robots: bool) -> bool:
        """Whether it is the same answer or a stronger one; if wanted, as to robots, too."""
        return (
            self.outcome == wanted.outcome
            and self.rounds >= wanted.rounds
            and (self.of_every_number or not (of_robots and wanted.of_every_number))
        )


def verdicts(measured: Measured) -> dict[str, Said]:
    """What is said of each claim."""
    found = measured.report()
    if found is None:
        return {}
    return {
        claim["name"]: Said(
            claim["outcome"],
            float("inf")
            if claim["all_rounds"] or claim["outcome"] == "violated"
            else float(-1 if claim["through_round"] is None else claim["through_round"]),
            claim["outcome"] == "holds" and claim["every_number_of_robots"],
        )
        for claim in found["claims"]
    }


def settles(said: dict[str, Said], wanted: dict[str, Said], *, of_robots: bool) -> bool:
    """Return whether somebody says as much of every claim; if wanted, as to robots, too."""
    return bool(wanted) and all(
        name in said and said[name].is_as_much_as(one, of_robots=of_robots)
        for name, one in wanted.items()
    )


def contradicts(one: dict[str, Said], other: dict[str, Said]) -> list[str]:
    """The claims that one shows to be violated and the other to hold in every round."""
    return [
        name
        for name in one.keys() & other.keys()
        if {one[name].outcome, other[name].outcome} == {"holds", "violated"}
        and float("inf") == one[name].rounds == other[name].rounds
    ]


def verified(row: Asked, engine: str, patience_s: float) -> Measured:
    # The last number of robots counts.
    asked = ("--robots", "any") if engine == EVERY_N else ("--engine", engine)
    words = (*asked, "--json", "--timeout", f"{patience_s:.2f}")
    return koord("verify", *row.words, *words, timeout_s=1.1 * patience_s + 5)


def portfolio(report: Report) -> None:
    patience_s = QUICK_S if report.quick else PATIENCE_S
    table = report.table(
        "auto and each engine alone: seconds on the clock",
        Column("row", "program"),
        Column("answer", "auto"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s"),
        *(Column(engine, engine) for engine in ENGINES),
        Column("best", "best"),
        Column("ratio", "ratio"),
        Column("excess_s", "excess s"),
        Column("cpu_excess_s", "CPU excess"),
        Column("met", "met"),
        Column("best_of_these", "best for these robots"),
        Column("excess_of_these_s", "excess s for these robots"),
        Column("met_of_these", "met for these robots"),
    )
    asked, kept = rows(), Kept()
    if wants("engines"):
        for row in asked:
            one = partial(beside_engines, report, row, patience_s)
            table.rows.append(kept.row("engines", row.name, one))
    if wants("vacuity"):
        shares(report, asked, patience_s, kept)


def beside_engines(report: Report, row: Asked, patience_s: float) -> dict[str, Cell]:
    """A row of the first table."""
    own = verified(row, "auto", patience_s)
    wanted = verdicts(own)
    cells: dict[str, Cell] = {
        "row": row.name,
        "answer": answer(own, wanted),
        "wall_s": round(own.wall_s, 3),
        "cpu_s": round(own.cpu_s, 3),
    }
    alone: dict[str, float] = {}
    of_these: dict[str, float] = {}
    for engine in ENGINES:
        given_s = patience_s if not wanted or "unknown" in answer(own, wanted) else own.wall_s
        measured = verified(row, engine, min(patience_s, given_s + 0.2))
        said = verdicts(measured)
        wrong = contradicts(wanted, said)
        report.expect(not wrong, f"{row.name}: auto and {engine} differ on {wrong}")
        cells[f"{engine}_cpu_s"] = round(measured.cpu_s, 3)
        if settles(said, wanted, of_robots=False):
            of_these[engine] = cells[engine] = round(measured.wall_s, 3)
        if settles(said, wanted, of_robots=True):
            alone[engine] = of_these[engine]
    if alone:
        best = min(alone, key=lambda engine: alone[engine])
        excess_s = beyond(own.wall_s, alone[best])
        cells |= {"best": best, "ratio": round(own.wall_s / alone[best], 2)}
        least = min(float(cells[f"{engine}_cpu_s"] or 0.0) for engine in alone)
        cells |= {"excess_s": round(excess_s, 2), "met": excess_s <= 0}
        cells["cpu_excess_s"] = round(beyond(own.cpu_s, least), 2)
    if of_these:
        best = min(of_these, key=lambda engine: of_these[engine])
        excess_s = beyond(own.wall_s, of_these[best])
        cells |= {"best_of_these": best, "excess_of_these_s": round(excess_s, 2)}
        cells["met_of_these"] = excess_s <= 0
    return cells


def beyond(own_s: float, best_s: float) -> float:
    """The seconds of `auto` beyond what it may take where the best engine took so many."""
    return own_s - TIMES * best_s - SECONDS


def answer(measured: Measured, said: dict[str, Said]) -> str:
    """The verdicts in few words."""
    if not said:
        return "given up" if measured.timed_out else f"no answer ({measured.code})"
    outcomes = [one.outcome for one in said.values()]
    return ", ".join(
        f"{outcomes.count(word)} {word}"
        for word in ("holds", "violated", "unknown")
        if word in outcomes
    )


# --- vacuity --------------------------------------------------------------------------------------


def shares(report: Report, asked: list[Asked], patience_s: float, kept: Kept) -> None:
    """The part of the look for vacuity, row by row."""
    table = report.table(
        "the look for vacuity: CPU seconds in one process",
        Column("row", "program"),
        Column("proofs_s", "verdicts"),
        Column("vacuity_s", "vacuity"),
        Column("share", "share"),
        Column("met", "met"),
    )
    for row in asked:
        table.rows.append(kept.row("vacuity", row.name, partial(share, row, patience_s)))


def share(row: Asked, patience_s: float) -> dict[str, Cell]:
    """A row of the second table."""
    command = [sys.executable, str(Path(__file__)), "--worker", *row.words]
    done = measure([*command, "--timeout", f"{patience_s}"], timeout_s=2 * patience_s)
    told = done.output.rsplit("vacuity: ", 1)
    if len(told) < 2:
        return {"row": row.name}
    vacuity_s, all_s = map(float, told[1].split())
    proofs_s = all_s - vacuity_s
    part = vacuity_s / proofs_s if proofs_s > 0 else 0.0
    return {
        "row": row.name,
        "proofs_s": round(proofs_s, 3),
        "vacuity_s": round(vacuity_s, 3),
        "share": round(part, 2),
        "met": part <= SHARE,
    }


def work(words: list[str]) -> None:
    """Verify in this process, and print the seconds of the look for vacuity and of all."""
    from koord.cli import main as frame
    from koord.verify.strategy import liveness, verification

    inside = False
    with TemporaryFile() as told:  # koord's work is done in a process of its own

        def timed(function: Callable[..., Any]) -> Callable[..., Any]:
            def run(*arguments: Any, **options: Any) -> Any:
                nonlocal inside
                if inside:
                    return function(*arguments, **options)
                begun, inside = used(), True
                try:
                    return function(*arguments, **options)
                finally:
                    inside = False
                    os.write(told.fileno(), f"{used() - begun}\n".encode())

            return run

        looks = [(verification, name) for name in ("look", "vacuities", "of_any_number")]
        for module, name in [*looks, (liveness, "vacuous_goals")]:
            setattr(module, name, timed(getattr(module, name)))
        begun = used()
        frame.main(["verify", *words, "--jobs", "1"])
        whole_s = used() - begun
        told.seek(0)
        print(f"vacuity: {sum(map(float, told.read().split()))} {whole_s}")


def used() -> float:
    """The CPU seconds of this process and of those that it waited for."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        work(sys.argv[2:])
        sys.exit(0)
    sys.exit(main("portfolio", __doc__ or "", portfolio))
