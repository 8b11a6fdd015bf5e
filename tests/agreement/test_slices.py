"""Engines on slices against the same engines on whole programs, and on programs with junk. [T-CONE]

Verdicts are those of the program without slices, be there junk in it or not; what an engine breaks
in the first round that breaks it is broken in the same one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.syntax.system import System
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted
from koord.verify.engines.explicit.search import survey
from koord.verify.reduction.influence import Cone, Part
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy import verification
from koord.verify.strategy.table import SAFETY
from koord.verify.verdicts import Outcome
from tests.generators.junk import with_junk
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.generators.staged import staged
from tests.generators.wellformed import complaints
from tests.sampling import first
from tests.verify.asking import ask

FAMILIES: dict[str, Callable[[Random], System]] = {
    "finite": partial(system, profile=FINITE),
    "symmetric": partial(system, profile=SYMMETRIC),
    "staged": staged,
}

ROUNDS = 4

#: They look at one round after the other, or at all configurations in their order.
IN_ORDER = (Engine.SEARCH, Engine.BMC)

#: abc is asked what bits are, by a program that may be missing.
ENGINES = [choice for choice in SAFETY if choice is not Engine.ABC]

#: A claim's outcome; the round that breaks it, or those it was seen to hold for.
Told = dict[str, tuple[Outcome, int | None]]


class Wholes(Slices, frozen=True):
    """Slices that leave out nothing."""

    def common(self) -> System:
        return self.system

    def extent(self, cone: Cone) -> frozenset[Part]:
        return self.everything


def told(of: System, choice: Engine | None, slices: type[Slices] = Slices) -> Told:
    """What is said of each claim that is not about junk; nobody asks what never happens."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verification, "Slices", slices)
        patch.setattr(verification, "look", lambda ledger: "")
        verdicts = list(ask(of, rounds=ROUNDS, choice=choice))
    return {
        v.claim.name: (v.outcome, v.rounds if v.counterexample is None else v.counterexample.round)
        for v in verdicts
        if "junk" not in v.claim.name
    }


def is_small(of: System) -> bool:
    """Whether there are few states, and any at all.

    A program that cannot start breaks nothing. A slice without what keeps it from starting may,
    and is not believed: then nothing is known of a program whose junk has no end.
    """
    limits = Limits(states=300, rounds=10)
    end = survey(of, of.program.properties, limits).end
    return isinstance(end, Exhausted) and end.states > 0


def compare(of: System, choice: Engine | None, seed: int) -> Counter[str]:
    """One engine on a program as a whole, on its slices, and on those of it with junk.

    A search sees all of the whole program, and so knows what is true of it.
    """
    if not is_small(of):
        return Counter(["large"])
    junky = with_junk(of, Random(seed))
    assert not list(complaints(junky.program)), seed
    truth, whole = told(of, Engine.SEARCH, Wholes), told(of, choice, Wholes)
    count: Counter[str] = Counter()
    for said in (told(of, choice), told(junky, choice)):
        assert said.keys() == truth.keys(), seed
        for name, (outcome, round_) in said.items():
            where = (seed, choice, name)
            expected, first = truth[name]
            if expected is Outcome.UNKNOWN:  # a statement about all positions, say
                count["not known to the search"] += 1
                continue
            if outcome is not Outcome.UNKNOWN:
                assert outcome is expected, where
            else:
                assert whole[name][0] is Outcome.UNKNOWN, where
                if round_ is not None and expected is Outcome.VIOLATED:
                    assert first is not None, where
                    assert first > round_, where
            if outcome is Outcome.VIOLATED and choice in IN_ORDER:
                assert round_ == first, where
            count[outcome.value] += 1
            count["only on slices"] += outcome is not whole[name][0]
    return count


def compared(choice: Engine | None, seeds: Iterable[int]) -> Counter[str]:
    """The same of several programs of each family."""
    cases = [(make(Random(seed)), seed) for make in FAMILIES.values() for seed in seeds]
    return sum((compare(of, choice, seed) for of, seed in cases), Counter[str]())


#: So many programs of each family are looked at by default.
FEW = {Engine.SEARCH: 2, Engine.BMC: 1, Engine.INDUCTION: 1, Engine.BITS: 1, None: 1}


@pytest.mark.parametrize("choice", first(2, FEW))
def test_slices_and_junk_change_no_verdict(choice: Engine | None) -> None:
    count = compared(choice, range(FEW[choice]))
    assert count["holds"] + count["violated"] > 5 * FEW[choice], count


@pytest.mark.slow
@pytest.mark.parametrize("choice", ENGINES)
@pytest.mark.parametrize("block", range(3))
def test_slices_and_junk_change_no_verdict_of_many(choice: Engine | None, block: int) -> None:
    count = compared(choice, range(100 + block * 5, 105 + block * 5))
    assert count["holds"] + count["violated"] > 10, count
