"""Reading programs: parsing, checking and laying out, by the number of lines; and hostile texts.

The programs are generated, deterministic, and mixed as real ones are: comments, enumerations,
records, functions, all four sorts of variables, events with branches, loops and locks, properties.
The limit is 3 s for parsing and checking 10,000 lines. A hostile text must end in diagnostics
(exit code 2) or be read, and never in a traceback.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

from harness import TIMES, Column, Report, in_child, koord, limited, main, note, times

LIMIT_S = 3.0
LIMITED_LINES = 10_000

MOTION = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target

param int spots = 4
param float near = 0.5
"""

#: Parts of a program, which use their own declarations and those of Motion. ``@`` is the number.
PARTS = (
    """
# Part @: robots claim spots one at a time and go there, in an order that is their own affair.
# A spot is free again when the robot that had it is done.
enum Mode@: idle@, going@, done@

def Spot@:
    pos place
    int owner = -1
    float since = 0.0
    bool open = true

def fun free@(Spot@[spots] all, float age) -> int:
    int found = -1
    for k = 0, spots:
        if found == -1 and all[k].open and all[k].owner == -1:
            if age - all[k].since >= near * 2.0 or all[k].since == 0.0:
                found = k
    return found

allwrite:
    Spot@[spots] board@
    int taken@ = 0

local:
    Mode@ mode@ = idle@
    int spot@ = -1
    float clock@ = 0.0

Claim@:
    pre: mode@ == idle@ and spot@ == -1 and not (taken@ >= spots)
    eff:
        atomic:
            spot@ = free@(board@, clock@)
            if spot@ != -1:
                board@[spot@].owner = pid
                board@[spot@].since = clock@
                taken@ = taken@ + 1
                mode@ = going@
                Motion.target = board@[spot@].place
            elif clock@ > 100.0:
                mode@ = done@
            else:
                clock@ = clock@ + delta

Arrive@:
    pre: mode@ == going@ and Motion.reached
    eff:
        mode@ = done@

invariant Bounds@: 0 <= taken@ and taken@ <= numAgents * spots
invariant Mine@: forall i: mode@@i == going@ implies 0 <= spot@@i and spot@@i < spots
invariant Alone@: forall i, j: i != j and spot@@i != -1 implies spot@@i != spot@@j
""",
    """
# Part @: everybody tells the others how far it has come; the slowest sets the pace.

def fun slowest@(float[] steps, int from) -> float:
    float least = steps[from]
    for k = 0, numAgents:
        least = min(least, steps[k])  // of all, whoever asks
    return least

def fun ahead@(float[] steps, int me) -> bool:
    return steps[me] - slowest@(steps, me) > near + 1.0 / (1.0 + abs(steps[me]))

allread:
    float[] steps@ = 0.0
    pos[] seen@

local:
    int waited@ = 0
    List<int> late@ = []

init:
    seen@[pid] = Motion.psn

Step@:
    pre: not ahead@(steps@, pid) and (waited@ == 0 or waited@ > 3)
    eff:
        steps@[pid] = steps@[pid] + delta * (1.5 - 0.25 * 2.0)
        seen@[pid] = Motion.psn
        waited@ = 0
        late@ = []
        for k = 0, numAgents:
            if steps@[k] < steps@[pid] - near and k != pid:
                late@.append(k)

urgent Wait@:
    pre: ahead@(steps@, pid)
    eff:
        waited@ = waited@ + 1
        if length(late@) > 0 and distance(seen@[late@[0]], Motion.psn) < near:
            Motion.target = midpoint(Motion.psn, seen@[late@[0]])
        else: Motion.target = Motion.psn

assume: forall i: steps@[i] == 0.0

invariant Pace@: forall i, j: steps@[i] - steps@[j] <= (
    near + 1.0 + 10.0 * delta
)
invariant Counts@ at round: waited@ >= 0
""",
)

#: The number of brackets, and of characters in a line, that a hostile text has.
BRACKETS = 10_000
LONG_LINE = 100_000
HUGE = 5_000_000
#: The longest text that is read at all.
LONGEST = 1_000_000


def program(lines: int) -> str:
    """A program of so many lines; parts that would go beyond are left out for comments."""
    text = [MOTION]
    total = MOTION.count("\n")
    for k in count():
        part = PARTS[k % len(PARTS)]
        # `v@@i` is the variable of this part at robot i
        part = part.replace("@@", f"{k}\0").replace("@", str(k)).replace("\0", "@")
        if total + part.count("\n") > lines:
            break
        text.append(part)
        total += part.count("\n")
    text.extend("# and so on\n" for _ in range(lines - total))
    return "".join(text)


def phases(path: str) -> dict[str, object]:
    """CPU seconds of parsing, checking (without parsing) and printing a file."""
    from koord.syntax.elaboration import elaborate
    from koord.syntax.parsing.parser import parse
    from koord.syntax.printing.program import print_program
    from koord.syntax.source import Source

    parse(Source("warm", "local:\n    int x = 0\n"))  # the parser's tables are made once
    source = Source(path, Path(path).read_text("utf-8"))
    begun = time.process_time()
    parsed = parse(source)
    read = time.process_time()
    elaborated = elaborate(parsed.program)
    checked = time.process_time()
    printed = print_program(parsed.program)
    done = time.process_time()
    diagnostics = [d.message for d in (*parsed.diagnostics, *elaborated.diagnostics)]
    return {
        "parse_s": read - begun,
        "check_s": checked - read,
        "print_s": done - checked,
        "lines": source.text.count("\n"),
        "printed": printed.count("\n"),
        "diagnostics": diagnostics[:5],
    }


def sizes(report: Report, folder: Path) -> None:
    by_phase = report.table(
        "Phases, CPU time without start-up",
        Column("lines", "lines"),
        Column("parse_s", "parse s"),
        Column("check_s", "check s"),
        Column("both_s", "parse + check s"),
        Column("per_s", "lines/s", 0),
        Column("print_s", "print s"),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    commands = report.table(
        "Commands, with start-up",
        Column("what", "command"),
        Column("lines", "lines"),
        *TIMES,
    )
    for lines in (1_000, 5_000) if report.quick else (1_000, 5_000, LIMITED_LINES):
        note(f"{lines} lines")
        path = folder / f"{lines}.krd"
        path.write_text(program(lines), "utf-8")
        found = in_child(phases, str(path), timeout_s=300)
        report.expect(not found["diagnostics"], f"{lines} lines: {found['diagnostics']}")
        report.expect(found["lines"] == lines, f"{lines} lines were to be {found['lines']}")
        both_s = found["parse_s"] + found["check_s"]
        by_phase.rows.append(
            {
                "lines": lines,
                "parse_s": found["parse_s"],
                "check_s": found["check_s"],
                "both_s": both_s,
                "per_s": lines / both_s,
                "print_s": found["print_s"],
                **limited(both_s, LIMIT_S if lines == LIMITED_LINES else None, "s CPU"),
            }
        )
        for words in (("check",), ("fmt", "--check")):
            done = koord(*words, str(path), timeout_s=300)
            what = " ".join(("koord", *words))
            report.expect(done.code in (0, 1), f"{what}, {lines} lines: exit code {done.code}")
            commands.rows.append({"what": what, "lines": lines, **times(done)})


def hostile_texts() -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Texts that nobody means, with what they are."""
    yield "5 MB of program", lambda: program(HUGE // 25)[:HUGE].encode()
    yield "5 MB of one letter", lambda: b"a" * HUGE
    yield "1 MB of program", lambda: program(LONGEST // 25)[:LONGEST].encode()
    yield "1 MB of line ends", lambda: b"\n" * LONGEST
    yield "1 MB of random bytes", lambda: random.Random(1).randbytes(LONGEST)
    yield "1 MB of colons", lambda: b":" * LONGEST
    for name, piece in (("a sum", b"1 + "), ("a name", b"a"), ("a string", b'"'), ("dots", b".")):
        line = piece * (LONG_LINE // len(piece))
        yield f"a line of 100,000 characters: {name}", _in_body(b"x = " + line)
    opening, closing = b"(" * BRACKETS, b")" * BRACKETS
    yield "10,000 brackets, closed", _in_body(b"x = " + opening + b"1" + closing)
    yield "10,000 brackets, open", _in_body(b"x = " + opening)
    yield "10,000 brackets, closing only", _in_body(b"x = 1" + closing)
    yield "10,000 list brackets", _in_body(b"x = " + b"[" * BRACKETS + b"]" * BRACKETS)
    yield "10,000 times not", _in_body(b"x = " + b"not " * BRACKETS + b"1")
    yield "10,000 blocks on a line", _in_body(b"else: " * BRACKETS)
    yield (
        "1,000 blocks, each in the one before",
        _in_body(b"".join(b" " * (8 + k) + b"if x == 1:\n" for k in range(1000)).lstrip()),
    )
    yield "10,000 mistakes", _in_body(_lines("x = = y", 10_000).encode().strip())
    yield "10,000 unknown names", _in_body(_lines("x = y{k}", 10_000).encode().strip())
    yield "2,000 misspelt names of 2,000", _misspelt
    yield "3,000 functions, each calls the one before", _chain
    yield "60 records, each has two of the one before", _doubling


def _misspelt() -> bytes:
    declared = "".join(f"    int value{k} = {k}\n" for k in range(2_000))
    return f"local:\n{declared}\nA:\n    eff:\n{_lines('valu{k} = 1', 2_000)}".encode()


def _chain() -> bytes:
    text = "def fun f0(int a) -> int:\n    return a\n\n"
    for k in range(1, 3_000):
        text += f"def fun f{k}(int a) -> int:\n    return f{k - 1}(a) + 1\n\n"
    return (text + "local:\n    int x = 0\n\nA:\n    eff:\n        x = f2999(x)\n").encode()


def _doubling() -> bytes:
    text = "def R0:\n    int a = 0\n\n"
    for k in range(1, 60):
        text += f"def R{k}:\n    R{k - 1} a\n    R{k - 1} b\n\n"
    return (text + "local:\n    R59 x\n    R59 y\n\nA:\n    eff:\n        x = y\n").encode()


def _lines(pattern: str, times: int) -> str:
    return "".join(f"        {pattern.format(k=k)}\n" for k in range(times))


def _in_body(line: bytes) -> Callable[[], bytes]:
    return lambda: b"local:\n    int x = 0\n\nA:\n    eff:\n        " + line + b"\n"


def hostile(report: Report, folder: Path) -> None:
    table = report.table(
        "Hostile texts: koord check, with start-up",
        Column("what", "text"),
        *TIMES,
        Column("lines", "lines of output"),
        Column("code", "exit"),
    )
    path = folder / "hostile.krd"
    for what, text in hostile_texts():
        note(what)
        path.write_bytes(text())
        done = koord("check", str(path), timeout_s=300)
        said = done.output + done.errors
        fine = done.code in (0, 2) and "Traceback" not in said and "internal error" not in said
        ending = "too long" if done.timed_out else f"exit code {done.code}: {said[-300:]}"
        report.expect(fine, f"{what}: {ending}")
        table.rows.append(
            {"what": what, **times(done), "lines": said.count("\n"), "code": done.code}
        )


def frontend(report: Report) -> None:
    with tempfile.TemporaryDirectory(prefix=f"koord-{os.getpid()}-") as folder:
        sizes(report, Path(folder))
        hostile(report, Path(folder))


if __name__ == "__main__":
    sys.exit(main("frontend", __doc__ or "", frontend))
