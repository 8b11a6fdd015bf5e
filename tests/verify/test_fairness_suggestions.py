"""Expectations that exclude a lasso: they can be read, and under them the lasso is not fair."""

from __future__ import annotations

from random import Random
from textwrap import dedent

import pytest
from msgspec.structs import replace

from koord.semantics.domain import EXACT
from koord.semantics.recordings import execute
from koord.syntax.elaboration import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.traces.fairness import excuses
from koord.traces.lassos import flaw_of
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import Limits
from koord.verify.fairness_suggestions import Lassoed, SourceTexts, excluding

RESTLESS = """
local:
    bool done = false
Idle:
    pre: not done
    eff: stop
Rest:
    pre: not done
    eff: done = false
Do:
    pre: not done
    eff: done = true
eventually Done: done
"""

SENSED = """
using Watch:
    sensors:
        bool there
local:
    bool gone = false
Go:
    pre: not gone and Watch.there
    eff: gone = true
eventually Away: gone
"""

DEAF = """
using Watch:
    sensors:
        bool there
    environment:
        there = false
local:
    int n = 0
First:
    pre: n == 0
    eff: n = 1
Go:
    pre: n == 1 and Watch.there
    eff: n = 2
eventually Away: n == 2
"""

STUCK = """
local:
    int n = 0
Up:
    pre: n == 1
    eff: n = 2
eventually Far: n == 2
"""


def suggested(text: str, robots: int = 2) -> tuple[str, ...]:
    """What is suggested for the lasso that the search finds; each is judged anew."""
    source = Source("program.krd", dedent(text))
    program = load(source).program
    assert program is not None
    of = dealt(program, robots)
    found = lively(of, program.properties, Limits(states=500))
    (stated,) = (p for p in program.properties if p.name in found.violated)
    recording = found.violated[stated.name]
    steps = execute(EXACT, of, recording)
    ends = [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]
    why = excuses(of, recording, ends)
    lines = excluding(
        SourceTexts(source, Settings(), ()), Lassoed(of, recording, ends, why, stated)
    )
    for line in lines:
        pasted = load(Source("program.krd", f"{dedent(text)}\n{line}\n")).program
        assert pasted is not None, line
        under: System = replace(of, program=pasted)
        flaw = flaw_of(under, recording, ends, None)
        assert flaw is not None, line
        assert flaw.rule == "FAIR-ASSUME"
        # The run is no counterexample any more, and not because there is no run at all.
        again = lively(under, pasted.properties, Limits(states=500))
        assert not again.is_empty, line
        assert again.violated.get(stated.name) != recording
    return lines


def test_what_is_enabled_and_never_runs_is_to_run() -> None:
    lines = suggested(RESTLESS, 1)
    assert "assume RunsDo: not done leadsto ran(Do)" in lines


def test_what_is_waited_for_comes() -> None:
    assert suggested(SENSED) == ("assume EnablesGo: not gone leadsto Watch.there",)


def test_what_the_program_itself_does_not_do_nobody_may_expect() -> None:
    assert suggested(STUCK) == ()


def test_what_no_run_meets_nobody_may_expect() -> None:
    assert suggested(DEAF) == ()


def made_up(random: Random) -> str:
    """A small program in which some events are enabled now and then, and some wait for a sensor."""
    lines = ["using Watch:", "    sensors:", "        bool there", "local:", "    int n = 0"]
    for name in ("First", "Second", "Third"):
        n, m = random.randrange(3), random.randrange(3)
        guard = random.choice(
            [f"n == {n}", f"n != {n}", f"n == {n} and Watch.there", f"n < {n} or Watch.there"]
        )
        lines += [f"{name}:", f"    pre: {guard}", f"    eff: n = {m}"]
    lines.append(f"eventually Goal: n == {random.randrange(1, 3)}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("block", range(2))
def test_what_is_suggested_for_programs_that_are_made_up(block: int) -> None:
    count = 0
    for seed in range(block * 8, block * 8 + 8):
        text = made_up(Random(seed))
        try:
            count += bool(suggested(text, 1 + seed % 2))
        except ValueError:
            continue  # the property holds
    assert count >= 1
