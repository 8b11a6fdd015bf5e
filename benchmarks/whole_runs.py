"""Claims of whole runs: koord's search for fair cycles beside SPIN, under weak fairness.

The models for SPIN are written by hand: a process a robot, each step of which is atomic. A round is
some of these steps, by different robots, so that the same configurations are reached: both tools
count them (SPIN in a search of its own, without the claim; koord's count is asked apart, too), and
a count that differs is a wrong answer. `Comes` is claimed of each robot: of SPIN as one formula for
all of them, or, in rows of its own, of robot 0 alone. Fairness is to processes as koord's is to
robots, and koord's proofs need no other (`-f`). A claim that is violated is told by SPIN when it
comes to a run that breaks it, by koord with one of the shortest, replayed. Koord leaves out what
the claim does not depend on;
"koord, all configurations" is its search without that, in a process of its own. SPIN's time is that
of translating, compiling and searching; its search alone is told beside, and the ratio is koord's
time by SPIN's, of CPU.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from msgspec import Struct

from claiming import OPTIMISED, Answer, in_turn, missing_of
from harness import BENCHMARKS, Cell, Column, Measured, Report, in_child, koord, main, note

PROGRAMS = BENCHMARKS / "programs"

PATIENCE_S = 120.0
QUICK_S = 30.0

#: SPIN keeps variables that are only written, too: they are a part of configurations.
_TRANSLATED = ("spin", "-a", "-o2", "model.pml")
_COMPILED = (*OPTIMISED, "-DNOREDUCE", "-DMEMLIM=12000", "-DNFAIR=4")


class Model(Struct, frozen=True):
    """A program, of whole runs with another file, and how it is written for SPIN."""

    name: str
    program: str
    more: str
    promela: Callable[[int, int], str]
    waits: str  #: what each robot waits for an end of, in Promela, and what that end is
    comes: str
    setting: str
    sizes: tuple[tuple[int, int], ...]
    claim: str = "Comes"
    answer: str = "holds"


def claiming(robots: int, tasks: int) -> str:
    """Claiming of tasks: a robot claims a free one, or completes its own."""
    assign = [
        f":: d_step {{ !onTask[_pid] && owner[{k}] == 0 -> onTask[_pid] = true; "
        f"mine[_pid] = {k + 1}; owner[{k}] = _pid + 1 }}"
        for k in range(tasks)
    ]
    return "\n".join(
        [
            f"bool onTask[{robots}]",
            f"byte mine[{robots}]",
            f"byte owner[{tasks}]",
            f"active [{robots}] proctype Robot() {{",
            "end: do",
            ":: d_step { onTask[_pid] -> onTask[_pid] = false }",
            *assign,
            "od }",
        ]
    )


def ring(robots: int, _: int) -> str:
    """A token that goes round."""
    onward = f"token = (token + 1) % {robots}"
    return "\n".join(
        [
            f"bool wants[{robots}]",
            f"bool works[{robots}]",
            "byte token",
            f"active [{robots}] proctype Robot() {{",
            "end: do",
            ":: d_step { !wants[_pid] -> wants[_pid] = true }",
            ":: d_step { wants[_pid] && !works[_pid] && token == _pid -> works[_pid] = true }",
            f":: d_step {{ works[_pid] -> works[_pid] = false; wants[_pid] = false; {onward} }}",
            f":: d_step {{ !wants[_pid] && token == _pid -> {onward} }}",
            "od }",
        ]
    )


MODELS = (
    Model(
        "claiming",
        "claiming.krd",
        "claiming_comes.krd",
        claiming,
        "onTask[{}]",
        "!onTask[{}]",
        "tasks",
        ((3, 4), (4, 5), (5, 6)),
    ),
    Model(
        "claiming, broken",
        "claiming.krd",
        "claiming_works.krd",
        claiming,
        "!onTask[{}]",
        "onTask[{}]",
        "tasks",
        ((3, 4), (4, 5), (5, 6)),
        "Works",
        "violated",
    ),
    Model("ring", "ring.krd", "", ring, "wants[{}]", "works[{}]", "size", ((8, 8), (12, 12))),
)


def formula(of: Model, robots: int) -> str:
    """The claim of some robots, the first ones."""
    each = [f"[] ({of.waits.format(i)} -> <> {of.comes.format(i)})" for i in range(robots)]
    return f"ltl {of.claim} {{ {' && '.join(each)} }}"


def by_spin(of: Model, robots: int, size: int, asked: int, patience_s: float) -> Answer:
    """SPIN on the claim of the first robots, under weak fairness."""
    if lacking := missing_of("spin", "gcc"):
        return Answer(lacking)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        text = f"{of.promela(robots, size)}\n{formula(of, asked)}\n"
        (folder / "model.pml").write_text(text, "utf-8")
        return in_turn(
            folder,
            patience_s,
            _TRANSLATED,
            (*_COMPILED, "-o", "pan", "pan.c"),
            ("./pan", "-a", "-f", "-m2000000", "-w24"),
            good=r"errors: 0\b()",
            bad=r"acceptance cycle|max search depth too small",
        )


def counted_by_spin(of: Model, robots: int, size: int, patience_s: float) -> int | None:
    """How many configurations SPIN's model reaches, whatever is claimed."""
    if missing_of("spin", "gcc"):
        return None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "model.pml").write_text(of.promela(robots, size), "utf-8")
        return in_turn(
            folder,
            patience_s,
            _TRANSLATED,
            (*_COMPILED, "-DSAFETY", "-o", "pan", "pan.c"),
            ("./pan", "-E", "-m1000000", "-w24"),
            good=r"errors: 0\b(?s:.*)\n *(\d+) states, stored",
            bad=r"assertion violated",
        ).states


def counted(program: str, setting: str, robots: int, size: int) -> int | None:
    """How many configurations koord's search reaches between rounds."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.engines.explicit.cost import COMPILED_FROM
    from koord.verify.engines.explicit.property_checks import Exhausted
    from koord.verify.engines.explicit.search import survey

    source = Source(program, (PROGRAMS / program).read_text("utf-8"))
    loaded = load(source, Settings({setting: size})).program
    assert loaded is not None
    found = survey(dealt(loaded, robots), (), symmetry=False, compiled_from=COMPILED_FROM)
    return found.end.states if isinstance(found.end, Exhausted) else None


def by_koord(of: Model, robots: int, size: int, patience_s: float, *words: str) -> Answer:
    """Koord on the claim of every robot."""
    sizes = ("--robots", str(robots), "--set", f"{of.setting}={size}")
    more = ("--with", str(PROGRAMS / of.more)) if of.more else ()
    asked = ("--property", of.claim, "--timeout", str(patience_s), *words)
    program = str(PROGRAMS / of.program)
    done = koord("verify", program, *more, *sizes, *asked, timeout_s=patience_s + 10)
    return Answer({0: "holds", 1: "violated"}.get(done.code, "gave up"), done)


def unsliced(
    program: str, more: str, setting: str, robots: int, size: int
) -> tuple[str, float, float]:
    """What koord's search says of the claim on all configurations, and its wall and CPU seconds."""
    started = time.monotonic()
    from koord.semantics.liveness import LIVENESS
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.engines.explicit.fair_search import lively

    first, *others = (Source(n, (PROGRAMS / n).read_text("utf-8")) for n in (program, more) if n)
    loaded = load(first, Settings({setting: size}), tuple(others)).program
    assert loaded is not None
    asked = [p for p in loaded.properties if p.kind in LIVENESS]
    found = lively(dealt(loaded, robots), asked)
    word = "holds" if found.needs else "violated" if found.violated else "gave up"
    return word, time.monotonic() - started, time.process_time()


def whole_runs(report: Report) -> None:
    """The table, a row for each size and tool."""
    patience_s = QUICK_S if report.quick else PATIENCE_S
    table = report.table(
        f"Claims of whole runs, under weak fairness, at most {patience_s:g} s",
        Column("model", "model"),
        Column("size", "robots / size"),
        Column("tool", "tool"),
        Column("answer", "answer"),
        Column("states", "configurations"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s"),
        Column("search_s", "search CPU s"),
        Column("ratio", "by SPIN's"),
        Column("peak_mib", "MiB", 0),
    )
    for of in MODELS:
        for robots, size in of.sizes[:-1] if report.quick else of.sizes:
            _rows(report, table.rows, of, robots, size, patience_s)


def _rows(
    report: Report,
    rows: list[Mapping[str, Cell]],
    of: Model,
    robots: int,
    size: int,
    patience_s: float,
) -> None:
    note(f"{of.name}, {robots} / {size}")
    counts = {
        "SPIN": counted_by_spin(of, robots, size, patience_s),
        "koord": in_child(counted, of.program, of.setting, robots, size),
    }
    known = {count for count in counts.values() if count is not None}
    report.expect(len(known) <= 1, f"{of.name}, {robots} / {size}: counts differ: {counts}")
    answers = {
        "SPIN": by_spin(of, robots, size, robots, patience_s),
        "SPIN, robot 0": by_spin(of, robots, size, 1, patience_s),
        "koord search": by_koord(of, robots, size, patience_s, "--engine", "search"),
        "koord": by_koord(of, robots, size, patience_s),
    }
    whole = in_child(unsliced, of.program, of.more, of.setting, robots, size)
    if whole is not None:
        done = Measured(0, whole[1], whole[2], 0.0, "", "", False)
        answers["koord, all configurations"] = Answer(whole[0], done)
    peer = answers["SPIN"].measured
    for tool, answer in answers.items():
        right = answer.word in (of.answer, "gave up") or answer.word.startswith("no ")
        report.expect(right, f"{of.name}, {robots} / {size}, {tool}: {answer.word}")
        count = counts["SPIN" if tool.startswith("SPIN") else "koord"]
        row: dict[str, Cell] = {
            "model": of.name,
            "size": f"{robots} / {size}",
            "tool": tool,
            "answer": answer.word,
            "states": count,
        }
        rows.append({**row, **_times(answer, peer)})
        note(str(rows[-1]))


def _times(answer: Answer, peer: Measured | None) -> dict[str, Cell]:
    done = answer.measured
    if done is None:
        return {}
    cells: dict[str, Cell] = {
        "wall_s": round(done.wall_s, 3),
        "cpu_s": round(done.cpu_s, 3),
        "peak_mib": round(done.peak_mib, 1),
    }
    if answer.search_s is not None:
        cells["search_s"] = round(answer.search_s, 3)
    if peer is not None and done is not peer and answer.word in ("holds", "violated"):
        cells["ratio"] = round(done.cpu_s / peer.cpu_s, 2)
    return cells


if __name__ == "__main__":
    sys.exit(main("whole_runs", __doc__ or "", whole_runs))
