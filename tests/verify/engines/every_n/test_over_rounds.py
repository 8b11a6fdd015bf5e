"""Induction over two rounds for every number of robots. [T-EVERY-N]"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.proving import prove, prove_over
from koord.verify.engines.every_n.questions import SPARING, Means
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.generators.profiles import FINITE
from tests.loading import EXAMPLES
from tests.sampling import first, sampled
from tests.verify.engines.every_n.asking import broken, system_of
from tests.verify.engines.every_n.test_generated import ROBOTS
from tests.verify.engines.every_n.test_generated import broken as broken_in


def _means() -> Means:
    return Means(Deadline(), Effort.of_seconds(SPARING.seconds), SPARING, 0)


def proved_over(made: System, rounds: int = 2) -> set[str]:
    """The claims that hold by induction over so many rounds, and the properties by one."""
    claims = claims_of(made)
    first = prove(made, claims, Deadline(), Effort.of_seconds(SPARING.seconds), SPARING)
    known = [claim for claim in first.proved if claim.is_state_property]
    left = [claim for claim in claims if claim not in first.proved]
    return {claim.name for claim in prove_over(made, left, known, _means(), rounds)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "name"), first(1, [("allstop.krd", "NoneAlone"), ("follow_points.krd", "Finished")])
)
def test_who_stops_together_has_seen_why(file: str, name: str) -> None:
    made = system_of((EXAMPLES / file).read_text(encoding="utf-8"))
    report = verify(made, Bounds(3), Engine.EVERY_N)
    verdict = next(v for v in report.verdicts if v.claim.name == name)
    assert (verdict.outcome, verdict.engine, verdict.depth) == (
        Outcome.HOLDS,
        Engine.EVERY_N,
        2,
    )


def test_who_stops_too_early_is_not_proved() -> None:
    """Robots ask to stop when one of them has halted, and not when all have."""
    text = (EXAMPLES / "allstop.krd").read_text(encoding="utf-8")
    early = text.replace("pre: all(halted)", "pre: any(halted) and halted[pid]")
    assert "NoneAlone" in proved_over(system_of(text))
    alone = early.replace("invariant NoneAlone: stopped implies all(halted)", NOT_ALL)
    assert "NotAll" not in proved_over(system_of(alone.replace("int work = 10", "int work = 1")))


NOT_ALL = "invariant NotAll: stopped implies not all(halted)"

#: A value that is left in the first round from where the text says it begins.
LEFT = """\
local:
    int x = {x}

urgent Step:
    pre: x == 0
    eff: x = 1

invariant NotOne: forall i: x@i != 1
"""


def test_the_first_rounds_count() -> None:
    """From a round between two in which it holds it would go on; but it begins otherwise."""
    assert proved_over(system_of(LEFT.format(x=5))) == {"NotOne"}
    assert proved_over(system_of(LEFT.format(x=0))) == set()
    assert broken(LEFT.format(x=0), 2) == {"NotOne"}


STEPS = """\
local:
    int x = 0

First:
    pre: x == 0
    eff: x = 1

Second:
    pre: x == 1
    eff: x = 2

invariant NotTwo: forall i: x@i != 2
"""


def test_rounds_that_follow_each_other_are_two() -> None:
    """What robots do in the one says nothing of what they do in the next."""
    assert proved_over(system_of(STEPS)) == set()
    assert proved_over(system_of(STEPS), 3) == set()
    assert broken(STEPS, 2) == {"NotTwo"}


LEAST = """\
allread:
    int[] level = 0

Rise:
    pre: level[pid] == min(level) and max(level) < 3
    eff: level[pid] = level[pid] + 1

invariant Flat: min(level) == max(level)
invariant Even: forall i, j: level[i] <= level[j] + 1
invariant Low: forall i: level[i] >= 0 and level[i] <= {top}
"""


@pytest.mark.parametrize(("top", "holds"), [(3, True), (2, False)])
def test_the_least_of_all_is_one_for_all_robots(*, top: int, holds: bool) -> None:
    text = LEAST.format(top=top)
    made = system_of(text)
    found = prove(made, claims_of(made), Deadline(), Effort.of_seconds(3), SPARING)
    names, violated = {claim.name for claim in found.proved}, broken(text, 2, rounds=8)
    assert ("Low" in names, "Low" in violated) == (holds, not holds)
    assert "Even" in names
    assert "Flat" in violated - names


def agreed(first: int, last: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in range(first, last):
        made = system(Random(seed), FINITE)
        names = proved_over(dealt(made.program, 2, made.delta_s))
        count["systems"] += 1
        count["proved"] += len(names)
        for robots in ROBOTS if names else ():
            seen = broken_in(made, robots)
            if seen is not None:
                assert not seen[0] & names, (seed, robots)
                count["compared"] += 1
    return count


@pytest.mark.parametrize("last", sampled(6, [120]))
def test_what_is_proved_over_two_rounds_is_refuted_for_none(last: int) -> None:
    assert agreed(0, last)["systems"] == last
