"""Variables that nothing depends on, and lassos that do not come back to them. [AUXILIARY]"""

from __future__ import annotations

import pytest

from koord.syntax.analysis.auxiliary import always_met, auxiliary
from koord.syntax.core import Home
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.verify.asking import of_text

DECLARED = """
def fun pick(int a) -> int: extern
using Eyes:
    sensors:
        int seen
        int other
    contract Rises:
        ensures: other' >= other and other' <= other + 1
using Mouth:
    actuators:
        int said = 0
allwrite:
    int total = 0
allread:
    int[] counts = 0
local:
    int x = 0
    int n = 0
    int m = 0
    int[] log = []
    Map<int, int> table = {}
E:
    pre: x < 3
    eff:
        %s
eventually Done: x == 3
"""

#: What an event does, and the variables of which none is auxiliary then.
KEPT = {
    "n = n + 1": "x",
    "n = m": "x",
    "n = m;x = n": "x n m",
    "n = m;m = n;x = m": "x n m",
    "n = 1 / m": "x n m",
    "n = log[0]": "x n log",
    "log.append(m)": "x",
    "table[m] = n": "x m",
    "table[0] = n": "x",
    "if n > 0:;    m = 1": "x n",
    "for k = 0, length(log):;    m = 1": "x log",
    "n = pick(m)": "x n m",
    "stdout << n": "x",
    "stdout << 1 / n": "x n",
    "counts[pid] = n": "x",
    "x = counts[m]": "x counts m",
    "atomic: total = total + n": "x",
    "x = total": "x total",
    "n = Eyes.seen": "x",
    "x = Eyes.seen": "x seen",
    "Mouth.said = n": "x",
    "n = Mouth.said;Mouth.said = 1": "x",
}


def names_of(text: str) -> set[str]:
    """The names of auxiliary variables of a program of one kind of robot."""
    system = of_text(text)
    program, (agent,) = system.program, system.program.agents
    of = {
        Home.LOCAL: [d.variable.name for d in agent.locals],
        Home.PORT: [p.declaration.variable.name for p in agent.ports],
        Home.ALLREAD: [d.variable.name for d in program.allread],
        Home.ALLWRITE: [d.variable.name for d in program.allwrite],
    }
    return {of[v.home][v.slot] for v in auxiliary(system, program.properties)}


@pytest.mark.parametrize("done", KEPT)
def test_a_variable_is_auxiliary_if_nothing_depends_on_it(done: str) -> None:
    every = {"seen", "other", "said", "total", "counts", "x", "n", "m", "log", "table"}
    text = DECLARED % done.replace(";", "\n        ")
    assert every - names_of(text) == {"other", *KEPT[done].split()}


def test_what_a_statement_about_whole_runs_reads_is_not_auxiliary() -> None:
    text = DECLARED % "n = m"
    assert {"n", "m"} <= names_of(text)
    assert "m" not in names_of(text.replace("x == 3", "n == 3"))
    assert "n" not in names_of(text + "assume A: n == 0 leadsto ran(E)\n")


SENSING = """
using Eyes:
    sensors:
        float level
        int count
        bool bright
    contract Says:
        {contract}
local:
    int x = 0
E:
    eff: x = 1
eventually Done: x == 1
"""

#: What a contract says, and the sensors of which some reading always keeps that.
SAID = {
    "ensures: level' > level": "level count",
    "ensures: level' > level and level' >= count and 2 < level'": "level count",
    "ensures: bright implies level' < level - 1": "level count",
    "ensures: count' == count + 1": "level count",
    "ensures: count' < level": "level count",
    "ensures: count' > level": "level count",
    "requires: level > 2;ensures: level' > level": "level count",
    # what is told from two sides, or of two readings, may be told of none
    "ensures: level' > level;ensures: level' < count": "count",
    "ensures: level' == level and level' == count": "count",
    "ensures: level' == level and level' > 0": "count",
    "ensures: level' > count'": "",
    "ensures: level' > count' and count' > level'": "",
    "ensures: level' > level';ensures: count' == 1": "count",
    "ensures: count' == level": "level",
    "ensures: level' != level": "count",
    "ensures: level' > level or level' < 0": "count",
    "ensures: not level' > level": "count",
    "ensures: level' > level and bright": "count",
    "ensures: level' > 1 / count": "count",
    "ensures: count' > 0 implies level' > 0": "",
    "requires: 1 / count > 0;ensures: level' > level": "",
    "ensures: bright'": "level count",
    "ensures: bright": "level count",
}


@pytest.mark.parametrize("said", SAID)
def test_a_sensor_is_always_met_if_there_is_a_reading_whatever_else_is_so(said: str) -> None:
    system = of_text(SENSING.format(contract=said.replace(";", "\n        ")))
    (agent,) = system.program.agents
    met = {agent.ports[slot].declaration.variable.name for slot in always_met(system, 0)}
    assert met - {"bright"} == set(SAID[said].split())
    assert "bright" not in met or "bright'" not in said


def test_a_sensor_that_is_always_met_is_auxiliary_if_nothing_else_reads_it() -> None:
    rises = SENSING.format(contract="ensures: level' > count")
    assert {"level", "count"} <= names_of(rises)
    # what is read draws what it rests on along
    assert "count" not in names_of(rises.replace("x = 1", "x = Eyes.count"))
    falls = SENSING.format(contract="ensures: count' < level")
    assert not {"level", "count"} & names_of(falls.replace("x = 1", "x = Eyes.count"))
    assert "level" not in names_of(rises.replace("x == 1", "level > 2"))
    for other in ("level' == level and level' > 0", "level' > level;ensures: level < 3"):
        text = SENSING.format(contract="ensures: " + other.replace(";", "\n        "))
        assert "level" not in names_of(text), other


#: A robot that drives, and a sensor besides that rises and rises.
DRIVING = """
using Motion:
    sensors:
        bool reached
using Spare:
    sensors:
        float level
    contract Rises:
        ensures: level' > level
local:
    int leg = 0
Go:
    pre: leg < 2 and Motion.reached
    eff: leg = leg + 1
assume Arrives: leg < 2 leadsto reached
eventually All: forall i: leg@i == 3
"""


def test_a_lasso_need_not_come_back_to_a_sensor_that_is_always_met() -> None:
    (verdict,) = verify(of_text(DRIVING, robots=1), Bounds(6), names=["All"]).verdicts
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None


@pytest.mark.slow
def test_a_lasso_comes_back_to_a_sensor_that_runs_out_of_readings() -> None:
    """There are no runs without end: no int rises and stays below 3 for ever."""
    text = DRIVING.replace("float level", "int level").replace("level' > level", "%s")
    ending = text % "level' > level and level' < 3"
    (verdict,) = verify(of_text(ending, robots=1), Bounds(6, 3.0), names=["All"]).verdicts
    assert verdict.outcome is not Outcome.VIOLATED
