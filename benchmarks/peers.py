"""SPIN, abc, rumur, TLC and mypyvy beside koord, where they are installed, paired in one run.

The claiming model is that of `claiming.py`, and invariants for every number of robots are those of
`every_number.py`; both run by themselves, too. In the first two tables SPIN gets
`programs/clear_tasks.krd`, Task with a sensor for whether a path is clear, through the translation
of `tests/peers` (Promela for what is left open, C for what the rules fix), for a number of rounds;
its time is that of translating, compiling and searching. abc's PDR gets the circuits of `koord
verify --export aiger`, beside koord's own IC3 on them; its time leaves out the making of the
circuit. There a ratio is the peer's wall time by koord's: above 1, koord is quicker.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from bits import asked
from claiming import abc_program, claiming
from every_number import every_number
from harness import (
    BENCHMARKS,
    EXAMPLES,
    NOTHING,
    Cell,
    Column,
    Measured,
    Report,
    koord,
    main,
    measure,
    note,
)

TASKS = BENCHMARKS / "programs" / "clear_tasks.krd"

#: Robots, tasks, rounds.
ROUNDS = ((2, 2, 5), (2, 3, 20), (3, 4, 20), (5, 6, 20))

#: File, robots, tasks (0: the program has none), the claims asked for (none: all).
CIRCUITS: tuple[tuple[str, int, int, tuple[str, ...]], ...] = (
    ("task.krd", 3, 4, ("Exclusive",)),
    ("sum_of_ids.krd", 3, 0, ()),
    ("task.krd", 5, 6, ("Exclusive",)),
    ("sum_of_ids.krd", 5, 0, ()),
    ("task.krd", 10, 10, ("Exclusive",)),
)

PATIENCE_S = 120.0
QUICK_S = 30.0

COLUMNS = (
    Column("program", "program"),
    Column("robots", "robots"),
    Column("tasks", "tasks"),
    Column("rounds", "rounds"),
    Column("koord", "koord"),
    Column("koord_s", "wall s"),
    Column("koord_cpu_s", "CPU s"),
    Column("peer", "peer"),
    Column("peer_s", "wall s"),
    Column("peer_cpu_s", "CPU s"),
    Column("ratio", "ratio"),
)


def beside(own: Measured, answer: str, peer: Measured | None, told: str) -> dict[str, Cell]:
    """The cells of one row; a peer that gave up makes its ratio a least one."""
    cells: dict[str, Cell] = {
        "koord": answer,
        "koord_s": round(own.wall_s, 3),
        "koord_cpu_s": round(own.cpu_s, 3),
        "peer": told,
    }
    if peer is None:
        return cells
    ratio = peer.wall_s / own.wall_s
    gave_up = told == "gave up"
    return {
        **cells,
        "peer_s": round(peer.wall_s, 3),
        "peer_cpu_s": round(peer.cpu_s, 3),
        "ratio": f"≥ {ratio:.2f}" if gave_up else round(ratio, 2),
    }


# --- SPIN -----------------------------------------------------------------------------------------


def spin(robots: int, tasks: int, rounds: int, patience_s: float) -> tuple[Measured | None, str]:
    """SPIN on the translated program, in a process of its own, and its answer in a word."""
    from tests.peers.spin import missing

    if lacking := missing():
        return None, f"no {lacking}"
    words = [str(robots), str(tasks), str(rounds), str(patience_s)]
    command = [sys.executable, str(Path(__file__)), "--spin", *words]
    done = measure(command, timeout_s=2 * patience_s)  # it keeps to its own: then all of it counts
    if done.timed_out or done.code == 3:
        return done, "gave up"
    return done, done.output.strip() or done.errors.strip().splitlines()[-1]


def work(robots: int, tasks: int, rounds: int, patience_s: float) -> int:
    """What SPIN's process does: translate, compile, search. Exit code 3 if it gave up."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from tests.peers.model import translate
    from tests.peers.spin import UnsureError, ask

    text = TASKS.read_text(encoding="utf-8")
    program = load(Source(TASKS.name, text), Settings({"tasks": tasks})).program
    assert program is not None
    system = dealt(program, robots)
    with tempfile.TemporaryDirectory() as folder:
        model = translate(system.program, system.kinds, rounds)
        try:
            answer = ask(model, Path(folder), seconds=patience_s, large=True)
        except UnsureError:
            return 3
    print(f"violated: {', '.join(answer.first)}" if answer.first else "holds")
    return 0


# --- abc ------------------------------------------------------------------------------------------


def abc(path: Path, patience_s: float) -> tuple[Measured | None, str]:
    """Abc's PDR on a circuit in binary AIGER, the only form that it reads."""
    program = abc_program()
    if program is None:
        return None, "no abc"
    done = measure([program, "-c", f"read_aiger {path}; pdr"], timeout_s=patience_s)
    if done.timed_out:
        return done, "gave up"
    proved = "Property proved" in done.output
    return done, "proved" if proved else f"no answer: {done.output[-200:]}"


# --- tables ---------------------------------------------------------------------------------------


def peers(report: Report) -> None:
    patience_s = QUICK_S if report.quick else PATIENCE_S
    searched = report.table("SPIN: all runs of so many rounds (koord: of all rounds)", *COLUMNS)
    for robots, tasks, rounds in ROUNDS[: 3 if report.quick else None]:
        note(f"SPIN, {robots} robots, {tasks} tasks, {rounds} rounds")
        words = ("--robots", str(robots), "--set", f"tasks={tasks}", "--rounds", str(rounds))
        own = koord("verify", str(TASKS), *words, timeout_s=patience_s)
        answer = {0: "holds", 1: "violated"}.get(own.code, "gave up")
        peer, told = spin(robots, tasks, rounds, patience_s)
        right = told in ("holds", "gave up") or peer is None
        report.expect(answer == "holds" and right, f"SPIN {words}: {answer}, {told}")
        size: dict[str, Cell] = {
            "program": TASKS.name,
            "robots": robots,
            "tasks": tasks,
            "rounds": rounds,
        }
        searched.rows.append({**size, **beside(own, answer, peer, told)})
    proved = report.table("abc: PDR on koord's circuits, every number of rounds", *COLUMNS)
    for file, robots, tasks, claims in CIRCUITS[: 2 if report.quick else None]:
        note(f"abc, {file}, {robots} robots, {tasks} tasks")
        own = asked("unbounded", file, robots, tasks, 0, *claims)
        answer = "proved" if "checked" in own.output else "gave up"
        peer, told = circuit(file, robots, tasks, claims, patience_s)
        right = told in ("proved", "gave up") or peer is None
        report.expect(answer == "proved" and right, f"{file}: {answer} {own.errors[-300:]}, {told}")
        size = {"program": file, "robots": robots, "tasks": tasks or NOTHING, "rounds": "all"}
        proved.rows.append({**size, **beside(own, answer, peer, told)})
    claiming(report)
    every_number(report)


def circuit(
    file: str, robots: int, tasks: int, claims: tuple[str, ...], patience_s: float
) -> tuple[Measured | None, str]:
    """The same question for abc."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "circuit.aig"
        words = ["verify", str(EXAMPLES / file), "--robots", str(robots)]
        words += ["--set", f"tasks={tasks}"] if tasks else []
        words += [word for claim in claims for word in ("--property", claim)]
        made = koord(*words, "--export", "aiger", "-o", str(path))
        if made.code != 0:
            return None, f"no circuit: {made.errors[-200:]}"
        return abc(path, patience_s)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--spin"]:
        numbers = [int(word) for word in sys.argv[2:5]]
        sys.exit(work(numbers[0], numbers[1], numbers[2], float(sys.argv[5])))
    sys.exit(main("peers", __doc__ or "", peers))
