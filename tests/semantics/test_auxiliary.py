"""Variables that nothing depends on, and lassos that do not come back to them. [AUXILIARY]"""

from __future__ import annotations

import pytest

from koord.semantics.auxiliary import auxiliary
from koord.syntax.core import Home
from tests.verify.asking import of_text

DECLARED = """
def fun pick(int a) -> int: extern
using Eyes:
    sensors:
        int seen
        int other
    contract Rises:
        ensures: other' > other
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
