"""What verdicts are known to be about: not looked for again where nothing of it has changed.

[PROP-VACUOUS]
"""

from __future__ import annotations

import pytest

from koord.syntax.system import System, dealt
from koord.verify.cache.verifying import CachedVerification
from koord.verify.strategy import verification
from koord.verify.strategy.verification import verify
from koord.verify.vacuity import analysis, reachability
from koord.verify.verdicts import Emptiness, Substance
from tests.loading import program_of
from tests.sampling import first
from tests.verify.cache.caching import SHORT, kept, new_cache, verified

SAYING = """
local:
    int n = 0
    int m = 0
Up:
    pre: n < 3
    eff: n = n + 1
Other:
    pre: m < 3
    eff: m = m + 1
invariant Small: forall i: n@i <= 3
invariant Other: forall i: m@i <= 3
invariant Late: forall i: n@i == 3 implies m@i <= 3
"""


def of(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def test_where_only_claims_go_nobody_is_asked_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    cache = new_cache()
    assert not verified(cache, of(SAYING)).vacuities
    monkeypatch.setattr(verification, "look", None)
    left = of(SAYING.replace("invariant Small: forall i: n@i <= 3\n", ""))
    cached = CachedVerification.begun(cache, left, SHORT)
    assert cached.answer is not None
    assert not cached.answer.vacuities


def test_of_a_claim_that_is_new_alone_it_is_asked_whether_it_says_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cache, asked = new_cache(), list[set[str]]()
    verified(cache, of(SAYING))
    unbroken = reachability.unbroken

    def noted(system, nevers, *others, **named):  # type: ignore[no-untyped-def]
        asked.append({never.name for never in nevers})
        return unbroken(system, nevers, *others, **named)

    monkeypatch.setattr(analysis, "unbroken", noted)
    new = "invariant New: forall i: {} implies m@i <= 3\n"
    found = verified(cache, of(SAYING + new.format("n@i == 77")))
    assert [(v.what, v.subject) for v in found.vacuities] == [(Emptiness.SUPPOSITION, "New")]
    assert all(len(names) == 1 for names in asked)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    first(
        1,
        [
            ("pre: m < 3", "pre: m < 3 and m > 5", Emptiness.EVENT),
            ("pre: n < 3", "pre: n < 2", Emptiness.SUPPOSITION),
            ("invariant Other: forall i: m@i", "invariant Other: forall i: 2", Emptiness.UNTOUCHED),
            ("local:", "assume: forall i: i < 0\nlocal:", Emptiness.ASSUMPTIONS),
        ],
    ),
)
def test_vacuities_of_a_change_are_told_as_without_a_cache(
    old: str, new: str, what: Emptiness
) -> None:
    cache = new_cache()
    verified(cache, of(SAYING))
    changed = of(SAYING.replace(old, new))
    found = verified(cache, changed)
    assert what in {each.what for each in found.vacuities}
    assert found.vacuities == verify(changed, SHORT).vacuities
    assert verified(cache, changed).vacuities == found.vacuities
    assert not verified(cache, of(SAYING)).vacuities


def test_what_is_known_counts_where_verdicts_are_as_they_were_thought_to_be() -> None:
    known = Substance(True, frozenset({"Small"}), every_n=True, all_rounds=True)
    assert known.where(every_n=True, all_rounds=True) == known.where(every_n=True) == known
    for every_n, all_rounds in ((False, True), (True, False), (False, None)):
        assert known.where(every_n=every_n, all_rounds=all_rounds) == Substance()


def test_of_few_of_the_claims_nothing_is_known_of_what_they_are_about() -> None:
    cache = new_cache()
    verified(cache, of(SAYING))
    some = CachedVerification.begun(cache, of(SAYING), SHORT, names=frozenset({"Small"}))
    assert some.substance == Substance()


def test_a_name_is_nothing_that_a_claim_says() -> None:
    cache = new_cache()
    verified(cache, of(SAYING))
    found = verified(cache, of(SAYING.replace("invariant Small", "invariant Little")))
    assert kept(found) == {"Little", "Other", "Late", "no fault"}
