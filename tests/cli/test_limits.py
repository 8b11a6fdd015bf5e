"""Every limit of specs/limits.md: what is at it or within passes, and one more is refused.

The tables there say which limits there are: a row without a case here fails, and so does a case
without a row, or with another number.
"""

from __future__ import annotations

import json
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path

import pytest

from koord.cli import arguments
from koord.cli.arguments import MOST_ROUNDS
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.recheck import certificate
from koord.runtime.compile import NumberTooLargeError, compiled
from koord.runtime.configuration import reading
from koord.runtime.configuration.checking import load as configured
from koord.sampling.running import MOST_LISTED, _check_all, _Scale
from koord.semantics.domain import EXACT, LONGEST_NUMBER_BITS, Constant, NumberTooLongError
from koord.semantics.every_number import NotFiniteError
from koord.semantics.storage import Cell
from koord.semantics.values import MOST_ROOM, Seq, put_at
from koord.syntax.analysis.limits import DEEPEST_TYPE, MOST_PARTS
from koord.syntax.analysis.work import MOST_DEEP, MOST_STEPS
from koord.syntax.core import LEAST_DELTA_S, MOST_DELTA_S, MOST_ROBOTS, BinaryOp
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration import Settings
from koord.syntax.elaboration.body import MAX_DEPTH
from koord.syntax.elaboration.resolve_types import MAX_SIZE
from koord.syntax.literals import MOST_DIGITS, MOST_PLACES
from koord.syntax.load import load
from koord.syntax.parsing.line_forms import MAX_DEPTH as MAX_OPERATORS
from koord.syntax.parsing.lines import MAX_BRACKETS
from koord.syntax.parsing.parser import MAX_BLOCKS, MAX_CHARACTERS, parse
from koord.syntax.source import Source
from koord.syntax.types import INT, ListType
from koord.traces import enumeration
from koord.traces.enumeration import Chooser, UnboundedError
from koord.verify.encoding.terms import Terms
from koord.verify.engines.explicit import limits
from koord.verify.engines.explicit.cells import MOST_SCALARS, Cells, Scalars, TooLargeError
from koord.verify.engines.explicit.limits import Limits, Meter
from tests.recheck.certificates import document_of

LIMITS = Path(__file__).parents[2] / "specs" / "limits.md"

HEAD = "local:\n  int x = 0\nGo:\n  pre: x < 0\n  eff:"


def errors(text: str) -> list[str]:
    """What is told of a program; each has a place and a cure."""
    found = load(Source("p.krd", text), Settings({}))
    refused = [d for d in found.diagnostics if d.severity.value == "error"]
    assert all(d.span.line >= 1 and d.hint for d in refused)
    return [d.code for d in refused]


def parse_errors(text: str) -> list[str]:
    return [d.code for d in parse(Source("p.krd", text)).diagnostics]


# --- texts with so much of something --------------------------------------------------------------


def characters(n: int) -> str:
    return f"{HEAD} x = 1\n#{'x' * (n - len(HEAD) - 9)}\n"


def brackets(n: int) -> str:
    return f"{HEAD} x = {'(' * n}1{')' * n}\n"


def blocks(n: int) -> str:
    """The event and its effect are two of them."""
    inside = "".join(f"{'  ' * i}if x < 0:\n" for i in range(2, n))
    return f"{HEAD}\n{inside}{'  ' * n}x = 1\n"


def operators(n: int) -> str:
    """Three of the levels are those of the statement."""
    return f"{HEAD} x = {'- ' * (n - 3)}x\n"


def nested(n: int) -> str:
    """The statement and the operand are levels, too."""
    return f"{HEAD} x = {'- ' * (n - 2)}1\n"


def array(n: int) -> str:
    return f"local:\n  int[{n}] y\nGo:\n  pre: y[0] < 0\n  eff: y[0] = 1\n"


def steps(n: int) -> str:
    """Two for each trip; negations make up for what is odd."""
    return f"{HEAD}\n    for i = 0, {(n - 8 - n % 2) // 2}:\n      stop\n{'    stop' * (n % 2)}\n"


def parts(n: int) -> str:
    """Of which one is a local."""
    return f"allwrite:\n  int[{n - 1}] y\n{HEAD} x = 1\n"


def calls(n: int) -> str:
    """Each call is two levels; there are six more."""
    made = ["def fun f0(int a) -> int:\n  return a + 1\n"]
    count = (n - 6) // 2 + n % 2
    for k in range(1, count + 1):
        value = "a + 1" if k > 1 or n % 2 == 0 else "a"
        made.append(f"def fun f{k}(int a) -> int:\n  return f{k - 1}({value})\n")
    return f"{''.join(made)}{HEAD} x = f{count}(x)\n"


def records(n: int) -> str:
    """A record of a number is two of them deep."""
    made = "def R0:\n  int a\n"
    made += "".join(f"def R{k}:\n  R{k - 1} a\n" for k in range(1, n - 1))
    return f"{made}local:\n  R{n - 2} r\nGo:\n  pre: false\n  eff: stop\n"


# --- the cases ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Case:
    """A limit: what the table says of it, what it is, and whether so much is refused."""

    what: str
    told: str
    most: int
    refuses: Callable[[int], bool]
    is_least: bool = False  #: it is the least that passes, and not the most
    is_slow: bool = False


def counted(what: str, most: int, refuses: Callable[[int], bool]) -> Case:
    return Case(what, f"{most:,}", most, refuses)


def coded(
    code: str, make: Callable[[int], str], of: Callable[[str], list[str]] = errors
) -> Callable[[int], bool]:
    """Whether a text is refused, with that code and no other."""

    def refuses(n: int) -> bool:
        found = of(make(n))
        assert found in ([], [code])
        return bool(found)

    return refuses


def refused_by(do: Callable[[], object], kind: type[Exception]) -> bool:
    try:
        do()
    except kind:
        return True
    return False


def robots(n: int) -> bool:
    """By a flag, by what a program states, and by a certificate."""
    refused = refused_by(lambda: arguments.fleet(str(n)), ArgumentTypeError)
    assert bool(errors(f"param int numAgents = {n}\n{HEAD} x = 1\n")) == refused
    document = document_of("hvac.krd", 1, Fraction(40))
    kept = json.dumps({**document, "kinds": [0] * n}).encode()
    assert refused_by(lambda: certificate.read(kept, "c.json"), KoordError) == refused
    return refused


def rounds(n: int) -> bool:
    return refused_by(lambda: arguments.rounds(str(n)), ArgumentTypeError)


def round_length(n: int) -> bool:
    """So many tenths of nanoseconds, by a flag, by a program, and by a configuration."""
    text = f"{n // TENTHS}.{n % TENTHS:010}"
    source = Source("c.yaml", f"num_robots: 1\npositions: {{0: [0, 0]}}\ndelta: {text}\n")
    refused = {
        refused_by(lambda: arguments.delta(text), ArgumentTypeError),
        bool(errors(f"param float delta = {text}\n{HEAD} x = 1\n")),
        refused_by(lambda: configured(source), KoordError),
    }
    assert len(refused) == 1, text
    return refused.pop()


def digits(n: int) -> bool:
    return refused_by(lambda: arguments.value("9" * n), ArgumentTypeError)


def powers(n: int) -> bool:
    """Very large and very small, by a flag, and by what a kept run or certificate says."""
    refused = set()
    for text, value in ((f"1e{n}", Fraction(10**n)), (f"-1e-{n}", -Fraction(1, 10**n))):
        refused.add(refused_by(lambda text=text: arguments.value(text), ArgumentTypeError))  # type: ignore[misc]
        found = load(Source("p.krd", f"param float k = 1\n{HEAD} x = 1\n"), Settings({"k": value}))
        refused.add("K237" in [d.code for d in found.diagnostics])
    assert len(refused) == 1
    return refused.pop()


def doubles(n: int) -> bool:
    """The largest double, and numbers by as much beside it as one double is from the next."""
    text = f"local:\n  float y = 1\nGo:\n  pre: y < 0\n  eff: y = {n}\n"
    program = load(Source("p.krd", text)).program
    assert program is not None
    return refused_by(partial(compiled, program), NumberTooLargeError)


def bits(n: int) -> bool:
    """By multiplication of exact numbers."""
    return refused_by(lambda: EXACT.binary(BinaryOp.MUL, 2 ** (n - 8), 2**7), NumberTooLongError)


def listed(n: int) -> bool:
    scale = _Scale()
    before: Cell[Constant] = Cell(True, Seq(1, (0,)))
    after: Cell[Constant] = Cell(True, Seq(n, (0,) * n))
    assert scale.listed(after) == n
    return refused_by(lambda: _check_all((before,), (after,)), KoordError)


def configured_values(n: int) -> bool:
    """The file, its field and the list are values, too."""
    text = f"unknown: [{'0,' * (n - 2)}]\n"
    return refused_by(lambda: reading.read(Source("c.yaml", text)), KoordError)


def room(n: int) -> bool:
    """The length that a list has by then."""
    d = Terms()
    unknown = d.fresh("at", INT)
    return refused_by(lambda: put_at(d, unknown, (0,) * (n - 1), 1), NotFiniteError)


def scalars(n: int) -> bool:
    cells = Cells(ListType(INT), 1, Scalars())
    content: Cell[Constant] = Cell(True, Seq(n, (0,) * n))
    return refused_by(lambda: cells.number(content), TooLargeError)


def options(n: int) -> bool:
    return refused_by(lambda: Chooser().pick(range(n)), UnboundedError)


def states(n: int) -> bool:
    return bool(Meter(Limits()).reached(n))


def memory(n: int) -> bool:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(limits, "resident_mb", lambda: float(n))
        return bool(Meter(Limits()).reached(1))


#: Tenths of nanoseconds of a second.
TENTHS = 10**10

CASES = (
    counted("characters of a file", MAX_CHARACTERS, coded("K106", characters)),
    counted("brackets inside brackets", MAX_BRACKETS, coded("K108", brackets)),
    counted("blocks inside blocks", MAX_BLOCKS, coded("K108", blocks)),
    counted(
        "operators and brackets in an expression, one inside the other",
        MAX_OPERATORS,
        coded("K109", operators, parse_errors),
    ),
    counted("expressions and blocks inside each other", MAX_DEPTH, coded("K231", nested)),
    counted("elements of one array", MAX_SIZE, coded("K227", array)),
    counted(
        "steps of an event, or of a statement about a configuration",
        MOST_STEPS,
        coded("K247", steps),
    ),
    counted("parts of all variables of a run together", MOST_PARTS, coded("K248", parts)),
    counted(
        "expressions, blocks and calls inside each other, calls followed",
        MOST_DEEP,
        coded("K249", calls),
    ),
    counted("records and lists made of each other", DEEPEST_TYPE, coded("K249", records)),
    counted("robots of a program, a flag or a certificate", MOST_ROBOTS, robots),
    counted("`--rounds`", MOST_ROUNDS, rounds),
    Case(
        "δ (`--delta`, `delta` of a program or a configuration), in seconds",
        "from 1e-9 to 1e5",
        int(MOST_DELTA_S * TENTHS),
        round_length,
    ),
    Case(
        "δ (`--delta`, `delta` of a program or a configuration), in seconds",
        "from 1e-9 to 1e5",
        int(LEAST_DELTA_S * TENTHS),
        round_length,
        is_least=True,
    ),
    counted("digits of a number that a flag or a configuration gives", MOST_DIGITS, digits),
    Case("numbers that params have, beside 0", "from 1e-400 to 1e400", MOST_PLACES, powers),
    Case(
        "floats of programs that are compiled",
        "doubles, to 1.8e308",
        2**53 - 1,
        lambda n: doubles(n * 2**971),
    ),
    counted("bits of an exact number", LONGEST_NUMBER_BITS, bits),
    counted("parts of the lists that one variable holds", MOST_LISTED, listed),
    Case(
        "values of a configuration",
        f"{reading.MOST_VALUES:,}",
        reading.MOST_VALUES,
        configured_values,
        is_slow=True,
    ),
    counted("elements that a list or map may have whose length is not known", MOST_ROOM, room),
    counted("scalars that one variable holds", MOST_SCALARS, scalars),
    counted("values of something that is left open", enumeration._MOST_OPTIONS, options),
    counted("states", Limits().states, states),
    counted("MB of memory", Limits().memory_mb, memory),
)


def rows() -> Iterator[tuple[str, str]]:
    """What is limited, and to what, as the tables have it."""
    for line in LIMITS.read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and cells[1] != "limit":
            yield cells[0], cells[1]


def test_the_tables_have_the_limits_that_there_are() -> None:
    assert list(rows()) == list(dict.fromkeys((case.what, case.told) for case in CASES))


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.what, marks=[pytest.mark.slow] if case.is_slow else [])
        for case in CASES
    ],
)
def test_what_passes_a_limit_is_refused_and_nothing_else(case: Case) -> None:
    beside = -1 if case.is_least else 1
    assert not case.refuses(case.most - beside)
    assert not case.refuses(case.most)
    assert case.refuses(case.most + beside)


#: What is asked of the deepest programs; the largest ones take long.
ASKED = {
    "check": [],
    "fmt": [],
    "run": ["--robots", "1", "--rounds", "1"],
    "compile": ["-o", "out.py"],
    "check-refinement": ["--runs", "1", "--rounds", "1"],
    **{
        f"verify --engine {engine}": ["--robots", "1", "--rounds", "1", "--timeout", "60"]
        for engine in ("bmc", "induction", "search", "bits", "spacer", "auto")
    },
}
DEEPEST = {
    "brackets": brackets(MAX_BRACKETS),
    "blocks": blocks(MAX_BLOCKS),
    "nested": nested(MAX_DEPTH),
    "calls": calls(MOST_DEEP),
    "records": records(DEEPEST_TYPE),
}


@pytest.mark.parametrize(
    "command",
    [c if c == "verify --engine bmc" else pytest.param(c, marks=pytest.mark.slow) for c in ASKED],
)
@pytest.mark.parametrize(
    "name", ["calls", *(pytest.param(n, marks=pytest.mark.slow) for n in DEEPEST if n != "calls")]
)
def test_all_commands_follow_the_deepest_programs(
    name: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.krd").write_text(DEEPEST[name], "utf-8")
    first, *flags = command.split()
    assert main([first, "p.krd", *flags, *ASKED[command]]) in (Exit.OK, Exit.VACUOUS)
