"""What holds of any bytes that are read as a program, and programs varied piece by piece."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from random import Random

from koord.cli.diagnostics import DiagnosticReport
from koord.syntax.catalogue import of_programs
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.load import load
from koord.syntax.parsing.parser import parse
from koord.syntax.parsing.tokens import KEYWORDS
from koord.syntax.printing.program import print_program
from koord.syntax.source import Source, normalise

ROOT = Path(__file__).parents[2]
NAME = "fuzzed.krd"


def examine(data: bytes) -> None:
    """Read, check, show and lay out. Raises if any of that does, or the layout is not stable."""
    source = Source(NAME, normalise(data.decode("utf-8", errors="replace")))
    elaborated = load(source)
    _shown(source, elaborated.diagnostics)
    errors = [d for d in elaborated.diagnostics if d.severity is Severity.ERROR]
    assert elaborated.program is None or not errors
    read = parse(source)
    if read.diagnostics:
        return
    laid_out = Source(NAME, print_program(read.program))
    again = parse(laid_out)
    assert again.diagnostics == ()
    assert again.program == read.program
    assert print_program(again.program) == laid_out.text
    if elaborated.program is not None:
        told = [d.code for d in load(laid_out).diagnostics]
        assert sorted(told) == sorted(d.code for d in elaborated.diagnostics)


def _shown(source: Source, diagnostics: tuple[Diagnostic, ...]) -> None:
    """Every diagnostic points into the text, and can be shown in both forms."""
    lines = source.text.count("\n") + 1
    for diagnostic in diagnostics:
        for span in (diagnostic.span, *(note.span for note in diagnostic.notes)):
            assert span.file == NAME
            assert 1 <= span.line <= span.end_line <= lines
            assert span.column >= 1
            assert (span.line, span.column) <= (span.end_line, span.end_column)
    report = DiagnosticReport()
    report.add(diagnostics, source)
    for as_json in (False, True):
        shown = io.StringIO()
        report.print(shown, as_json=as_json)
        shown.getvalue().encode("utf-8")
        if as_json:
            json.loads(shown.getvalue())


def seeds() -> list[Path]:
    """The programs that fuzzing begins with."""
    folders = ("specs/examples", "tests/syntax/golden", "tests/fuzz", "koord/syntax")
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.krd"))


def write_seeds(folder: Path) -> None:
    """Write the programs that fuzzing begins with; those of the catalogue are the shortest."""
    texts = [path.read_bytes() for path in seeds()]
    for entry in of_programs().values():
        texts += [entry.bad.encode("utf-8"), entry.good.encode("utf-8")]
    for number, text in enumerate(texts):
        (folder / f"{number}.krd").write_bytes(text)


# --- variations ---------------------------------------------------------------------------------

_PIECE = re.compile(r"\n[ ]*|[ \t]+|\w+|<<|->|[=!<>]=|.", re.DOTALL)

_WORDS = [
    *sorted(KEYWORDS),
    *"()[]{},.:=<>+-*/%@'#",
    *("==", "!=", "<=", ">=", "<<", "->", "++", "--", "//", '"', "≤", "&&", "\\", "\t", "\r", "é"),
    *("0", "1", "-1", "1.5", "1e400", "x", "y", "E", "i", "pid", "numAgents", "delta", "Motion"),
    *("int", "float", "bool", "string", "pos", "Task", "Map<int, pos>", "Queue<int>", "[]"),
    *("extern", "fresh", "requires", "ensures", "sensors", "actuators", "environment", "contract"),
    *("choose(0, 1)", "ran(E)", "result", "list", "at round", "fun", "adt", "append(x, 1)", "pop"),
    *("findPath", "allAssigned", "length(x)", "stopped", "stdout", "forall i: ", "atomic: "),
    *("\n", "\n  ", "\n    ", "\n        ", "\nE:\n  eff: ", "\nlocal:\n  int x", "\ninvariant: "),
]


def varied(data: bytes, random: Random) -> bytes:
    """The program with a few pieces taken out, put in, repeated or moved."""
    pieces = _PIECE.findall(data.decode("utf-8", errors="replace"))
    for _ in range(random.randint(1, 6)):
        _vary(pieces, random)
    return "".join(pieces).encode("utf-8")


def _vary(pieces: list[str], random: Random) -> None:
    at = random.randint(0, len(pieces))
    to = min(len(pieces), at + random.choice((0, 1, 1, 2, 5, 20)))
    match random.randrange(6):
        case 0:
            del pieces[at:to]
        case 1:
            pieces[at:to] = [random.choice(_WORDS)]
        case 2:
            pieces[at:at] = [random.choice(_WORDS), " "]
        case 3:
            pieces[at:at] = pieces[at:to]
        case 4:
            other = random.randint(0, len(pieces))
            pieces[other:other] = pieces[at:to]
        case _:
            ends = [number for number, piece in enumerate(pieces) if piece.startswith("\n")]
            if ends:
                end = random.choice(ends)
                wide = max(0, len(pieces[end]) - 1 + random.choice((-4, -2, -1, 1, 2, 4)))
                pieces[end] = "\n" + " " * wide
