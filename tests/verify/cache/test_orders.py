"""Orders that mean nothing are one in the form of a slice; those that mean something stay."""

from __future__ import annotations

from random import Random

import pytest
from msgspec.structs import replace

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs, Recording, execute
from koord.syntax.system import System, dealt
from koord.syntax.walk import asks
from koord.verify.cache.forms import Form
from koord.verify.cache.orders import in_order, statement_in_order
from koord.verify.claims import claims_of
from koord.verify.reduction.slicing import Slices
from tests.generators.large import large
from tests.generators.profiles import FINITE
from tests.generators.runs import recording
from tests.loading import program_of
from tests.sampling import first

TEXT = """
using Tank:
    sensors:
        float level
    actuators:
        bool open
enum Colour: red, green
local:
    int n = 0
    int m = 0
    int late
    bool on = false
    Colour shade = red
    int[2] own = [0, 0]
allwrite:
    int all = 0
    int[2] board
def fun half(int a) -> int:
    return 12 / a
def fun any(int a) -> int: extern
init:
    INI
Go:
    pre: PRE
    eff:
        EFF
invariant Said: SAID
"""

START = {"INI": "on = true", "PRE": "on", "EFF": "n = 1", "SAID": "forall i: n@i < 3"}


def form_of(**parts: str) -> str:
    text = TEXT
    for name, part in (START | parts).items():
        text = text.replace(name, part.replace("\n", "\n" + (4 if name == "INI" else 8) * " "), 1)
    system = dealt(program_of(text), 2)
    form = Form.of(system, Slices(system).everything)
    return form.text + form.claim(claims_of(system)[0])


GUARDS = [
    ("on and n < 3", "n < 3 and on"),
    ("on or n < 3 or all > 4", "all > 4 or on or n < 3"),
    ("on and (n < 3 and shade == red)", "shade == red and on and n < 3"),
    ("n + m == 3", "3 == m + n"),
    ("on and Tank.level > 1.0", "Tank.level > 1.0 and on"),
    ("12 / n == board[m]", "board[m] == 12 / n"),
    ("half(n) > 1 and (on and n < 3)", "half(n) > 1 and (n < 3 and on)"),
]

EFFECTS = [
    ("n = 1\nm = 2", "m = 2\nn = 1"),
    ("n = m\non = not on\nshade = green", "shade = green\nn = m\non = not on"),
    ("if on and n > 2:\n    n = 0\n    m = 0", "if n > 2 and on:\n    m = 0\n    n = 0"),
    ("for k = 0, 2:\n    n = k\n    m = all", "for k = 0, 2:\n    m = all\n    n = k"),
    ("n = n + 1\nm = m + 1", "m = 1 + m\nn = 1 + n"),
]

STATEMENTS = [
    ("forall i, j: i != j implies n@i != n@j", "forall i, j: j != i implies n@j != n@i"),
    ("forall i: n@i < 3 and half(n@i) < 9", "forall i: half(n@i) < 9 and n@i < 3"),
    ("(forall i: n@i < 3) and board[all] < 1", "board[all] < 1 and (forall i: n@i < 3)"),
    ("exists i: on@i and n@i < 3", "exists i: n@i < 3 and on@i"),
]

SAME = [("PRE", *pair) for pair in GUARDS] + [("EFF", *pair) for pair in EFFECTS]
SAME += [("SAID", *pair) for pair in STATEMENTS]


@pytest.mark.parametrize(("where", "one", "other"), SAME)
def test_what_may_change_places_is_in_one_order(where: str, one: str, other: str) -> None:
    assert form_of(**{where: one}) == form_of(**{where: other})


OTHER = [
    # What comes first keeps the other from being looked at, which may fault.
    ("PRE", "n > 0 and 12 / n > 2", "12 / n > 2 and n > 0"),
    ("PRE", "n > 0 and late > 2", "late > 2 and n > 0"),
    ("PRE", "on or Tank.open", "Tank.open or on"),
    ("PRE", "n < 2 and board[n] == 0", "board[n] == 0 and n < 2"),
    ("PRE", "n > 0 and half(n) > 2", "half(n) > 2 and n > 0"),
    ("PRE", "n - m > 2", "m - n > 2"),
    ("PRE", "n < m", "m < n"),
    ("PRE", "on and n > 2 or m > 1", "on and (n > 2 or m > 1)"),
    # Whoever asks first hears another answer.
    ("INI", "n = choose(0, 3) - 1\nm = choose(0, 3)", "m = choose(0, 3)\nn = choose(0, 3) - 1"),
    ("EFF", "n = m\nm = 2", "m = 2\nn = m"),
    ("EFF", "n = 1\nn = 2", "n = 2\nn = 1"),
    ("EFF", "n = late\nm = 1", "m = 1\nn = late"),
    ("EFF", "all = 1\nn = 2", "n = 2\nall = 1"),
    ("EFF", "own[0] = 1\nn = 2", "n = 2\nown[0] = 1"),
    ("EFF", "n = 1\nstop\nm = 2", "m = 2\nstop\nn = 1"),
    ("EFF", "n = all\nall = 2\nm = all", "m = all\nall = 2\nn = all"),
    # A fault inside another statement than a conjunction may be what makes it true, or not.
    ("SAID", "exists i: n@i > 0 and 12 / n@i > 2", "exists i: 12 / n@i > 2 and n@i > 0"),
    ("SAID", "forall i: n@i > 0 or 12 / n@i > 2", "forall i: 12 / n@i > 2 or n@i > 0"),
    ("SAID", "forall i: n@i > 0 implies on@i", "forall i: on@i implies n@i > 0"),
    ("SAID", "any(n@0) == 1 and any(n@1) == 2", "any(n@1) == 2 and any(n@0) == 1"),
]


@pytest.mark.parametrize(("where", "one", "other"), OTHER)
def test_what_may_not_change_places_stays_where_it_is(where: str, one: str, other: str) -> None:
    assert form_of(**{where: one}) != form_of(**{where: other})


# --- by the rules ---------------------------------------------------------------------------------


def configurations(system: System, run: Recording) -> list[Configuration[Constant]]:
    """The configurations of a run, without the places of faults."""
    steps = execute(EXACT, system, run)
    return [replace(s.configuration, fault=None) for s in steps]


@pytest.mark.parametrize("seeds", first(1, [range(60), range(60, 900)]))
def test_programs_in_order_have_the_same_runs(seeds: range) -> None:
    changed = 0
    for seed in seeds:
        system = large(Random(seed), FINITE)
        ordered = replace(system, program=in_order(system.program))
        changed += ordered.program != system.program
        for one, other in ((system, ordered), (ordered, system)):
            run = recording(Random(seed), one, rounds=3)
            if run is not None:
                assert configurations(one, run) == configurations(other, run), seed
    assert 3 * changed > len(seeds)


def test_statements_in_order_are_true_in_the_same_configurations() -> None:
    changed = 0
    for seed in range(60):
        system = large(Random(seed), FINITE)
        run = recording(Random(seed), system, rounds=3)
        stated = [p for p in system.program.properties if not asks(system.program, p.condition)]
        for p in stated if run is not None else []:
            assert run is not None
            ordered = statement_in_order(system.program, p.condition)
            changed += ordered != p.condition
            for configuration in configurations(system, run):
                said = [
                    holds_in(EXACT, system, configuration, e, p.bound, RecordedInputs())
                    for e in (p.condition, ordered)
                ]
                assert said[0] == said[1], seed
    assert changed > 5
