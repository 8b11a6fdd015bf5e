"""Claims about whole runs on slices, on whole programs, and on programs with junk. [T-CONE]

What is said of slices is what a search says of the whole program; a lasso has as many rounds, and
is judged as a run of the whole program. With junk no run may come back to where it was: then it
comes back to all but auxiliary variables. [AUXILIARY]
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.compiled_replay import rerun
from koord.refinement.generating.programs import system
from koord.traces.trace import Numbers, traced
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.property_checks import Exhausted
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.liveness import settled
from koord.verify.strategy.table import LIVENESS
from koord.verify.verdicts import Bounds, Outcome
from tests.agreement.test_lassos import LIVELY, searched, with_liveness
from tests.generators.junk import with_junk
from tests.semantics.driving import NO_TEXT


def compare(seed: int, choice: Engine | None, most: int) -> Counter[str]:
    """What engines say of slices, with and without junk, is what the search says of all.

    It is of programs with so many configurations at most.
    """
    random = Random(seed)
    of = with_liveness(system(random, LIVELY), random)
    found = searched(of)
    if found is None or not isinstance(found.end, Exhausted) or found.end.states > most:
        return Counter(["too large, or not finite"])
    count: Counter[str] = Counter()
    for asked in (of, with_junk(of, random, events=False)):
        rows, slices = LIVENESS[choice], Slices(asked)
        for verdict in settled(slices, Bounds(8), rows, Deadline.after(None)).verdicts:
            where = (seed, verdict.claim.name, asked is of)
            count[verdict.outcome.value] += 1
            if choice is Engine.SEARCH:
                assert verdict.outcome is not Outcome.UNKNOWN, where
            if verdict.outcome is Outcome.UNKNOWN:
                continue
            lasso = found.violated.get(verdict.claim.name)
            assert (verdict.outcome is Outcome.VIOLATED) == (lasso is not None), where
            if verdict.counterexample is not None:
                assert lasso is not None
                recording = verdict.counterexample.recording
                if choice is Engine.SEARCH:
                    assert len(recording.rounds) <= len(lasso.rounds), where
                count["with junk"] += asked is not of
                assert rerun(traced(NO_TEXT, asked, Numbers.EXACT, recording)) is None, where
    return count


@pytest.mark.slow
def test_slices_and_junk_change_nothing_that_is_said_of_whole_runs() -> None:
    count = sum((compare(seed, Engine.SEARCH, 60) for seed in range(10)), Counter[str]())
    assert count["with junk"] > 2, count
    assert count["holds"] > 5, count


@pytest.mark.slow
@pytest.mark.parametrize("choice", [Engine.SEARCH, Engine.BITS, None])
@pytest.mark.parametrize("block", range(4))
def test_slices_and_junk_change_nothing_of_many(choice: Engine | None, block: int) -> None:
    seeds = range(100 + block * 40, 140 + block * 40)
    count = sum((compare(seed, choice, 400) for seed in seeds), Counter[str]())
    assert count["with junk"] > 10, count
