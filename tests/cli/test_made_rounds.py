"""Rounds that code made are shown as their steps are. [EVENT-TRANS] [ENV-TRANS] [SKIP]"""

from __future__ import annotations

from random import Random

import pytest

from koord.cli.tables import Rounds, RunTable
from koord.cli.terminal import PLAIN, Style
from koord.refinement.generating.palette import GENERAL
from koord.refinement.generating.programs import system as generated
from koord.sampling.made_rounds import MadeRound
from koord.sampling.monitors import Search
from koord.sampling.policies import AtRandom, Play
from koord.sampling.running import new_run
from koord.semantics.rounds import IllegalStepError
from koord.syntax.diagnostics import KoordError
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.traces.names import Names
from koord.traces.trace import Numbers
from tests.loading import example_program

#: Wide tables, and narrow ones, in which lines break.
STYLES = (PLAIN, Style(40, colour=True))


def shown(
    system: System,
    capsys: pytest.CaptureFixture[str],
    *,
    numbers: Numbers = Numbers.EXACT,
    style: Style = PLAIN,
    whole: bool,
) -> tuple[str, int]:
    """What is printed of a run, by whole rounds or by steps; how many rounds code made."""
    rng = Random(3)
    run = new_run(system, numbers, rng, kept=False)
    play = Play(run, AtRandom(rng), 25, Search(run.d, system, run.inputs))
    rounds, made = Rounds(RunTable(Names(system), style)), 0
    try:
        for part in play.parts():
            if not isinstance(part, MadeRound):
                rounds.show(part)
            elif whole:
                made += 1
                rounds.show_round(part)
            else:
                for taken in part.steps():
                    rounds.show(taken)
    except (KoordError, IllegalStepError):
        pass
    rounds.close()
    return capsys.readouterr().out, made


@pytest.mark.parametrize("style", STYLES, ids=["wide", "narrow"])
@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize(
    "name", ["fischer", "sats", "leader_elect", "sum_of_ids", "hvac", "traffic", "lineform_1d"]
)
def test_examples(
    name: str, numbers: Numbers, style: Style, capsys: pytest.CaptureFixture[str]
) -> None:
    system = dealt(example_program(name), 4)
    by_rounds, made = shown(system, capsys, numbers=numbers, style=style, whole=True)
    assert by_rounds == shown(system, capsys, numbers=numbers, style=style, whole=False)[0]
    assert made > 10


@pytest.mark.parametrize("seed", range(12))
def test_generated_programs(seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    system = generated(Random(seed), GENERAL)
    by_rounds, _ = shown(system, capsys, whole=True)
    assert by_rounds == shown(system, capsys, whole=False)[0]


TOLD = """\
enum Light: red, green
allread:
  Light[] light = red
  float[] level = 0.0
allwrite:
  int last = -1
  int count = 0
local:
  int waits = 0
  int late
Wave:
  pre: waits < 6
  eff:
    atomic:
      last = pid
      count = count
    waits = waits + 1
    stdout << "wave " << waits << " of " << level[pid]
Switch:
  pre: waits % 2 == 1
  eff:
    light[pid] = green
    level[pid] = level[pid] + 1.0 / 3.0
    late = waits
Rest:
  pre: waits > 2
  eff: waits = waits
"""


def test_what_is_told_in_many_ways(capsys: pytest.CaptureFixture[str]) -> None:
    program = load(Source("told.krd", TOLD)).program
    assert program is not None
    text, made = shown(dealt(program, 4), capsys, whole=True)
    assert text == shown(dealt(program, 4), capsys, whole=False)[0]
    assert made > 10
    for told in ("lost its lock", "nothing changes", "stdout <<", "light[2]: red → green", "skip"):
        assert told in text, told
