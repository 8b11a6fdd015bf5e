"""What has no influence on whether anything happens costs nothing where that is asked. [T-CONE]"""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.verify.asking import of_text

COUNTING = """
{declared}
local:
    int x = 0
{more}
Up:
    pre: x < 5
    eff:
        x = x + 1
Never:
    pre: x > 5
    eff:
        x = 0
{event}
invariant A: forall i: x@i >= 0
"""


def counting(declared: str = "", more: str = "", event: str = "") -> System:
    return of_text(COUNTING.format(declared=declared, more=more, event=event))


def spare(contract: str = "") -> str:
    return "using Spare:\n    sensors:\n        float level\n        pos place\n" + contract


def promising(*promises: str, requires: str = "") -> str:
    lines = [f"        requires: {requires}\n"] if requires else []
    lines += [f"        ensures: {promise}\n" for promise in promises]
    return spare("    contract Says:\n" + "".join(lines))


#: Nothing hangs on these, and runs go on whatever they are.
LEFT_OUT = {
    "sensors": counting(spare()),
    "a sensor that rises": counting(promising("level' > level")),
    "a local that is written": counting(more="    int n = 0", event=""),
}

#: These may end runs, keep them from starting, or should happen themselves.
LOOKED_AT = {
    "no reading may be allowed": counting(promising("level' > level", "level' < 3")),
    "no round may end": counting(promising("level < 3")),
    "no run may start": counting(spare(), event="assume: forall i: level@i > 3\n"),
    "a contract supposes something": counting(promising("level' > level", requires="level > 3")),
    "a promise supposes something": counting(promising("level > 3 implies level' > level")),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_what_nothing_hangs_on_is_left_out(name: str) -> None:
    system = LEFT_OUT[name]
    part = Slices(system).happening()
    assert part is not system
    assert len(Slices(part).everything) == len(Slices(system).everything)  # nothing is renumbered
    assert [c.name for c in claims_of(part)] == [c.name for c in claims_of(system)]
    plain, asked = (verify(each, Bounds(3)) for each in (counting(), system))
    (told,) = plain.vacuities
    (said,) = asked.vacuities
    assert replace(said, span=told.span) == told
    assert told.subject == "Never"


@pytest.mark.parametrize("name", LOOKED_AT)
def test_what_may_end_runs_or_should_happen_is_looked_at(name: str) -> None:
    system = LOOKED_AT[name]
    assert Slices(system).happening() is system
