"""The engine on bits: rounds by SAT alone, and proofs for all rounds by IC3 alone.

Each row is a process of its own, start-up included. `Exclusive` of task.krd is asked alone, so no
other claim serves as a lemma; paths are opaque values. `peers.py` has abc beside it.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from harness import (
    EXAMPLES,
    LIMITS,
    TIMES,
    Column,
    Measured,
    Report,
    limited,
    main,
    measure,
    note,
    times,
)

#: File, robots, tasks (0: the program has none), rounds, claims (none: all), limit in seconds.
BOUNDED: tuple[tuple[str, int, int, int, tuple[str, ...], float], ...] = (
    ("task.krd", 5, 6, 20, ("Exclusive",), 5.0),
    ("sum_of_ids.krd", 5, 0, 20, (), 2.0),
    ("task.krd", 10, 10, 20, ("Exclusive",), 60.0),
)

#: Robots, tasks, limit in seconds.
UNBOUNDED = ((5, 6, None), (10, 10, 10.0), (20, 20, 120.0))

PATIENCE_S = 400.0


def asked(how: str, file: str, robots: int, tasks: int, rounds: int, *claims: str) -> Measured:
    """One question to one part of the engine, in a process of its own."""
    words = [how, str(EXAMPLES / file), str(robots), str(tasks), str(rounds), *claims]
    command = [sys.executable, str(Path(__file__)), "--worker", *words]
    return measure(command, timeout_s=PATIENCE_S)


def work(how: str, path: str, robots: str, tasks: str, rounds: str, *names: str) -> str:
    """What the process does: the answer in a word."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.claims import claims_of
    from koord.verify.effort import Deadline
    from koord.verify.encoding.solver import SolverAnswer
    from koord.verify.engines.bits import ic3
    from koord.verify.engines.bits.circuit import circuit_of
    from koord.verify.engines.bits.clauses import QUICK, Clauses
    from koord.verify.engines.bits.constraint_selection import narrowed
    from koord.verify.engines.bits.robot_permutations import images
    from koord.verify.engines.bits.unrolling import UnrolledCircuit, holds_always
    from koord.verify.reduction.abstraction import abstracted

    settings = Settings({"tasks": int(tasks)} if int(tasks) else {})
    program = load(Source(path, Path(path).read_text(encoding="utf-8")), settings).program
    assert program is not None
    abstraction = abstracted(program)
    system = dealt(program if abstraction is None else abstraction.program, int(robots))
    claims = [claim for claim in claims_of(system) if not names or claim.name in names]
    circuit = circuit_of(system, claims)
    g = circuit.d.graph
    if how == "bounded":
        unrolled = UnrolledCircuit(circuit)
        for _ in range(int(rounds)):
            copy = unrolled.begin()
            broken = [x for phases in circuit.bad.values() for _, x in phases]
            bad = copy.of(g.any_of([circuit.lost, *broken]))
            if unrolled.asked(bad, Deadline()) is not SolverAnswer.UNSAT:
                return "violated"
            unrolled.never(bad)
        return f"holds for {rounds} rounds"
    question = narrowed(circuit, claims, (), between=False)
    properties = tuple(claim.stated for claim in claims if claim.stated is not None)
    renamed = images(system, properties, question.latches)
    search = ic3.Ic3Run(Clauses(g, QUICK), question, Deadline(), renamed)
    found = search.run()
    if not isinstance(found, ic3.ClauseInvariant):
        return "no invariant"
    assert holds_always(g, question, found.cubes)
    return f"{len(found.cubes)} clauses, checked"


def bits(report: Report) -> None:
    columns = (
        Column("file", "program"),
        Column("robots", "robots"),
        Column("tasks", "tasks"),
        Column("answer", "answer"),
        *TIMES,
        *LIMITS,
    )
    bounded = report.table("rounds unrolled, SAT alone", *columns)
    for file, robots, tasks, rounds, claims, limit_s in BOUNDED[: 2 if report.quick else None]:
        note(f"{file}, {robots} robots, {tasks} tasks, {rounds} rounds")
        done = asked("bounded", file, robots, tasks, rounds, *claims)
        answer = done.output.strip() or "given up"
        right = answer.startswith("holds") or done.timed_out
        report.expect(right, f"{file}: {done.errors[-300:]}")
        bounded.rows.append(
            {
                "file": file,
                "robots": robots,
                "tasks": tasks,
                "answer": answer,
                **times(done),
                **limited(done.wall_s if answer.startswith("holds") else math.inf, limit_s),
            }
        )
    unbounded = report.table("task.krd, Exclusive alone, all rounds: IC3", *columns)
    for robots, tasks, limit in UNBOUNDED[: 2 if report.quick else None]:
        note(f"IC3, {robots} robots, {tasks} tasks")
        done = asked("unbounded", "task.krd", robots, tasks, 0, "Exclusive")
        answer = done.output.strip() or "given up"
        report.expect("checked" in answer or done.timed_out, f"IC3: {done.errors[-300:]}")
        unbounded.rows.append(
            {
                "file": "task.krd",
                "robots": robots,
                "tasks": tasks,
                "answer": answer,
                **times(done),
                **limited(done.wall_s if "checked" in answer else math.inf, limit),
            }
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        print(work(*sys.argv[2:]))
        sys.exit(0)
    sys.exit(main("bits", __doc__ or "", bits))
