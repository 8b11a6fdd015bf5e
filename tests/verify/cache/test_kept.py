"""Kept verdicts: shown again where nothing that they depend on has changed, and only there."""

from __future__ import annotations

import json
from fractions import Fraction
from random import Random

import pytest
from msgspec.structs import replace

from koord.stores.store import MemoryStore
from koord.syntax.system import System, dealt
from koord.verify.cache.dependence import Dependences, Question
from koord.verify.cache.kept import VerdictCache
from koord.verify.cache.verifying import CachedVerification
from koord.verify.claims import ClaimKind
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from koord.verify.witness import replayed
from tests.generators.mutating import mutants
from tests.loading import EXAMPLES, example_program, program_of
from tests.sampling import first
from tests.verify.cache.caching import (
    SHORT,
    dependences,
    kept,
    new_cache,
    verified,
    without_times,
)

TASK = (EXAMPLES / "task.krd").read_text("utf-8")

#: Two counters that know nothing of each other, one of them broken in the end.
TEXT = """
local:
    int steps = 0
    int laps = 0
allwrite:
    int sum = 0
Step:
    pre: steps < 3
    eff:
        atomic:
            steps = steps + 1
            sum = sum + 1
Lap:
    pre: laps < 2
    eff: laps = laps + 1
invariant Within: forall i: steps@i <= 3
invariant Laps: forall i: laps@i <= 2
invariant Never: forall i: steps@i < 2
eventually Done: forall i: steps@i == 3
"""


def of(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def task(*edits: tuple[str, str]) -> System:
    """The task program with some words in the place of others."""
    text = TASK
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    return dealt(program_of(text), 3)


def reused(before: System, after: System) -> set[str]:
    """The claims of a system whose verdicts would be those of another, without asking anybody."""
    one, other = dependences(before), dependences(after)
    found = set()
    for claim in one.claims:
        names = one.looked_at(claim, [], whole=False)
        for same in other.claims:
            is_alike = one.asked(claim) == other.asked(same)
            if is_alike and one.key(claim, names) == other.key(same, names):
                found.add(claim.name)
    return found


ALL = {"Holds", "Exclusive", "Route", "Along", "Clearance", "no fault", "Visited"}

#: What leaves all verdicts as they are.
IDLE = {
    "a comment": (("init:", "# about init\ninit:"),),
    "lines": (("init:\n", "\n\ninit:\n"),),
    "a variable": (("    int mine = -1", "    int spare = 3\n    int mine = -1"),),
    "a param": (("param int tasks = 4", "param int tasks = 4\nparam int spare = 7"),),
    "a claim more": (("invariant Route:", "invariant More: tasks > 0\ninvariant Route:"),),
    "the name of a claim": (("invariant Route:", "invariant Routes:"),),
    "the sides of a claim": (("mine@i != mine@j\n", "mine@j != mine@i\n"),),
    "the sides of a guard": (("isOnTask and Motion.reached", "Motion.reached and isOnTask"),),
    "words of a claim": (("invariant Route: forall i: ", "invariant Route:\n    forall i: "),),
    "a variable that is counted": (
        ("    int mine = -1", "    int spare = 0\n    int mine = -1"),
        ("        isOnTask = false\n", "        isOnTask = false\n        spare = spare + 1\n"),
    ),
}


@pytest.mark.parametrize("edit", IDLE.values(), ids=IDLE)
def test_verdicts_are_kept_where_nothing_that_matters_has_changed(
    edit: tuple[tuple[str, str], ...],
) -> None:
    assert reused(task(), task(*edit)) == ALL


#: What leaves the others as they are, and not these.
OF_CLAIMS = {
    "a claim": (
        (("mine@i != mine@j\n", "mine@i != mine@j or tasks < 0\n"),),
        {"Exclusive"},
    ),
    "what a claim is about": ((("Along at round:", "Along:"),), {"Along"}),
    "what is claimed of whole runs": (
        (("eventually Visited: allAssigned(list) and", "eventually Visited:"),),
        {"Visited"},
    ),
    "what is expected": ((("assume Arrives: isOnTask", "assume Arrives: true"),), {"Visited"}),
    "an event that claims about states do not see": (
        (
            ("    int mine = -1", "    int spare = 0\n    int mine = -1"),
            (
                "assume: forall k",
                "Idle:\n    pre: spare < 3\n    eff: spare = 4\n\nassume: forall k",
            ),
        ),
        {"Visited"},
    ),
}


@pytest.mark.parametrize(("edit", "asked"), OF_CLAIMS.values(), ids=OF_CLAIMS)
def test_only_claims_that_a_change_touches_are_asked_again(
    edit: tuple[tuple[str, str], ...], asked: set[str]
) -> None:
    assert reused(task(), task(*edit)) == ALL - asked


#: What all claims of the program depend on, in each of its sections.
TOUCHING = {
    "a guard": ("pre: not isOnTask", "pre: not isOnTask and mine < 3"),
    "an effect": ("mine = i\n", "mine = i + 1\n"),
    "a statement less": ("                        Motion.path = testRoute\n", ""),
    "a condition": ("not list[i].assigned and", "list[i].assigned and"),
    "a lock": ("else: atomic:", "else:"),
    "how robots stop": (": stop\n", ": trystop()\n"),
    "INIT": ("    Motion.path = [Motion.psn]\n\nAssign", "\nAssign"),
    "a start": ("int mine = -1", "int mine = -2"),
    "a param": ("tasks = 4", "tasks = 5"),
    "a contract": ("ensures: onPath(psn', path)", "ensures: not onPath(psn', path)"),
    "a summary": ("        result == pathsClear(b, a)\n", ""),
    "an assumption": ("assume: onPath(Motion.psn, Motion.path)\n", ""),
    "urgency": ("\nComplete:", "\nurgent Complete:"),
}


@pytest.mark.parametrize("edit", first(6, ((edit,) for edit in TOUCHING.values())), ids=TOUCHING)
def test_nothing_is_kept_where_what_all_depend_on_has_changed(edit: tuple[str, str]) -> None:
    assert reused(task(), task(edit)) == set()


def test_verdicts_are_of_a_question() -> None:
    """Of so many robots, so long rounds, so many of them, an engine, a seed and a version."""
    system = of(TEXT)
    questions = [
        (system, Question(4)),
        (of(TEXT, 3), Question(4)),
        (dealt(program_of(TEXT), 2, Fraction(1, 3)), Question(4)),
        (system, Question(5)),
        (system, Question(4, Engine.BMC)),
        (system, Question(4, seed=1)),
        (system, Question(4, version="2")),
    ]
    keys = set()
    for each, question in questions:
        found = Dependences(each, question)
        claim = found.claims[0]
        names = found.looked_at(claim, [], whole=False)
        keys |= {found.asked(claim), found.key(claim, names)}
    assert len(keys) == 2 * len(questions)


def test_the_same_is_said_from_a_cache_as_without() -> None:
    cache, system = new_cache(), of(TEXT)
    first = verified(cache, system)
    again = verified(cache, of(TEXT))
    assert without_times(first) == without_times(verify(system, SHORT))
    assert without_times(again) == without_times(first)
    assert not kept(first)
    assert kept(again) == {verdict.claim.name for verdict in first.verdicts}
    moved = verified(cache, of("# moved\n" + TEXT))
    assert kept(moved) == kept(again)
    (shown,) = (v.counterexample for v in moved.verdicts if v.counterexample is not None)
    assert shown.span is not None
    assert shown.span.line == 19  # where the claim stands now


def test_a_change_of_one_part_asks_nothing_of_others() -> None:
    """A claim more is asked for by itself, with the help of those that are known."""
    cache = new_cache()
    verified(cache, of(TEXT))
    more = TEXT + "invariant Twice: forall i: laps@i * 2 <= 4\n"
    found = verified(cache, of(more))
    assert {v.claim.name for v in found.verdicts} - kept(found) == {"Twice"}
    assert all(v.outcome is Outcome.HOLDS for v in found.verdicts if v.claim.name == "Twice")


def test_a_violation_is_kept_only_if_it_is_a_run_of_the_program() -> None:
    """Its run is told by slots and positions, so that these have to be the same."""
    cache = new_cache()
    verified(cache, of(TEXT))
    for edit in ("    int spare = 0\n    int steps = 0", "    int steps = 0\n    int spare = 0"):
        found = verified(cache, of(TEXT.replace("    int steps = 0", edit, 1)))
        assert "Within" in kept(found)
        shown = {v.claim.name: v for v in found.verdicts}["Never"]
        assert shown.outcome is Outcome.VIOLATED
        system = of(TEXT.replace("    int steps = 0", edit, 1))
        run = shown.counterexample
        assert run is not None
        replayed(system, run.recording, shown.claim, run.phase)


def test_what_is_unknown_is_asked_again() -> None:
    cache, system = new_cache(), of(TEXT)
    hasty = verified(cache, system, Bounds(rounds=4, timeout_s=0.0))
    assert {v.outcome for v in hasty.verdicts} == {Outcome.UNKNOWN}
    assert not kept(verified(cache, system))


def test_what_holds_for_some_rounds_is_kept_where_time_played_no_part() -> None:
    text = TEXT.replace("steps < 3", "true").replace("invariant Within", "invariant Not")
    text = text.replace("<= 3", "<= 99").replace("invariant Never: forall i: steps@i < 2\n", "")
    text = text.replace("eventually Done: forall i: steps@i == 3\n", "")
    system = of(text)

    def bounded(bounds: Bounds) -> set[str]:
        cache = new_cache()
        first = verified(cache, system, bounds, Engine.BMC)
        assert {v.rounds for v in first.verdicts} == {2}
        return kept(verified(cache, system, bounds, Engine.BMC))

    assert "Not" in bounded(Bounds(rounds=2))
    assert bounded(Bounds(rounds=2, timeout_s=600.0)) == set()


# --- what proofs rest on --------------------------------------------------------------------------

#: Who may start contradicts itself in a part that `Small` says nothing of.
APART = """
local:
    int x = 0
    int y
Go:
    pre: true
    eff: x = x + 1
assume: forall i: {}
invariant Small: forall i: x@i < 2
invariant Own: forall i: y@i == y@i
"""


def test_a_part_that_helped_is_looked_at_although_the_claim_does_not_read_it() -> None:
    """No run starts, so everything holds; then runs start, and `Small` is false of them."""
    cache = new_cache()
    verified(cache, of(APART.format("y@i != y@i")))
    found = verified(cache, of(APART.format("y@i == y@i")))
    (small,) = (v for v in found.verdicts if v.claim.name == "Small")
    assert small.outcome is Outcome.VIOLATED


@pytest.mark.slow
def test_a_part_that_was_asked_about_although_no_claim_reads_it_is_looked_at() -> None:
    """What seems to break `Small` starts nowhere, which only the whole program tells."""
    cache = new_cache()
    apart = APART.replace("invariant Own: forall i: y@i == y@i\n", "")
    assert not verify(of(apart.format("y@i != y@i")), SHORT).of_slice
    verified(cache, of(apart.format("y@i != y@i")))
    found = outcomes(verified(cache, of(apart.format("y@i == y@i"))))
    assert found["Small"] is Outcome.VIOLATED


def test_invariants_that_were_found_are_kept_with_the_slots_that_they_name() -> None:
    cache, system = new_cache(), of(TEXT)
    found = dependences(system)
    claim = next(c for c in found.claims if c.name == "Within")
    lemma = next(c.stated for c in found.claims if c.name == "Laps")
    assert lemma is not None
    verdict = Verdict(claim, Outcome.HOLDS, Engine.BITS, 1.0, lemmas=(lemma,))
    cache.keep(found, Report((verdict,), (), 1.0, of_slice=True), SHORT)
    assert cache.known(found)[claim].verdict.lemmas == (lemma,)
    moved = TEXT.replace("    int steps = 0", "    int spare = 0\n    int steps = 0", 1)
    assert not cache.known(dependences(of(moved)))


def test_a_verdict_depends_on_all_that_known_ones_do_which_helped_it() -> None:
    """`Small` is known to hold as no run starts; `Less` is proved of less, but with its help."""
    cache = new_cache()
    empty = APART.format("y@i != y@i")
    verified(cache, of(empty))
    alone = empty.replace("invariant Own: forall i: y@i == y@i\n", "")
    helped = verified(cache, of(alone + "invariant Less: forall i: x@i < 3\n"))
    assert "Small" in kept(helped)
    runs = APART.format("y@i == y@i").replace("invariant Own: forall i: y@i == y@i\n", "")
    found = verified(cache, of(runs + "invariant Less: forall i: x@i < 3\n"))
    outcomes = {v.claim.name: v.outcome for v in found.verdicts}
    assert outcomes["Small"] is outcomes["Less"] is Outcome.VIOLATED


def test_the_whole_program_counts_where_more_than_a_slice_was_asked() -> None:
    system = of(TEXT)
    found = dependences(system)
    claim = next(c for c in found.claims if c.name == "Within")
    common = found.looked_at(claim, [], whole=False)
    whole = found.looked_at(claim, [], whole=True)
    assert set(common) <= set(whole)
    report = verify(system, SHORT)
    cache = new_cache()
    cache.keep(found, replace(report, of_slice=False), SHORT)
    (entry,) = json.loads(cache.store.get(found.asked(claim)) or b"")["alike"]
    assert tuple(entry["names"]) == whole


# --- programs with mistakes -----------------------------------------------------------------------

#: Examples of which a round is looked at soon, with robots, and each so many-th mutant.
SMALL = [("leader_elect", 3, 20), ("allstop", 3, 120), ("sum_of_ids", 2, 240)]


@pytest.mark.parametrize(
    ("name", "robots", "step"), first(1, SMALL), ids=[name for name, _, _ in SMALL]
)
def test_mistakes_are_told_with_a_cache_as_without(name: str, robots: int, step: int) -> None:
    """A cache that has seen the program without them, and those before, contradicts nobody."""
    program = example_program(name)
    cache, bounds = new_cache(), Bounds(rounds=3)
    verified(cache, dealt(program, robots), bounds)
    made = list(mutants(program))
    for mutant in made[::step] if step else made:
        system = dealt(mutant.program, robots)
        with_cache = outcomes(verified(cache, system, bounds))
        without = outcomes(verify(system, bounds))
        for claim, outcome in without.items():
            if Outcome.UNKNOWN not in (outcome, with_cache[claim]):
                assert with_cache[claim] is outcome, (str(mutant), claim)


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(3)))
def test_going_back_and_forth_between_texts_says_the_same_of_each(seed: int) -> None:
    """Edits are made and undone at random; what is said of a text is always the same."""
    edits = [
        ("steps < 3", "steps < 4"),
        ("laps < 2", "laps < 1"),
        ("int sum = 0", "int sum = 1"),
        ("steps@i < 2", "steps@i < 5"),
        ("            sum = sum + 1\n", "            sum = 1\n"),
        ("invariant Laps: forall i: laps@i <= 2\n", "invariant Laps: sum <= 7\n"),
        ("local:\n    int steps", "local:\n    int more = 0\n    int steps"),
    ]
    random, cache, said = Random(seed), new_cache(), dict[str, dict[str, Outcome]]()
    text = TEXT
    for _ in range(6):
        old, new = random.choice(edits)
        text = text.replace(old, new, 1) if old in text else text.replace(new, old, 1)
        found = outcomes(verified(cache, of(text), Bounds(rounds=6)))
        fresh = outcomes(verify(of(text), Bounds(rounds=6)))
        assert found == fresh
        assert said.setdefault(text, found) == found


def outcomes(report: Report) -> dict[str, Outcome]:
    return {v.claim.name: v.outcome for v in report.verdicts}


# --- runs that reach what should be possible ------------------------------------------------------


def test_runs_that_reach_goals_are_known_of_whatever_becomes_of_a_program() -> None:
    cache = new_cache()
    found = verified(cache, of(TEXT))
    assert found.reaching
    changed = CachedVerification.begun(cache, of(TEXT.replace("steps < 3", "steps < 4")), SHORT)
    assert set(changed.past.reaching) == set(found.reaching)


def test_runs_that_are_damaged_are_forgotten() -> None:
    notes: list[str] = []
    cache = VerdictCache(MemoryStore(), notes.append)
    verified(cache, of(TEXT))
    found = dependences(of(TEXT))
    cache.store.put(found.lineage, b'{"runs": [{"struct": "os.system"}]}')
    assert not cache.reaching(found)
    assert cache.store.get(found.lineage) is None
    assert notes
    cache.store.put(found.lineage, b'{"runs": [7]}')
    assert not cache.reaching(found)


# --- what is not kept -----------------------------------------------------------------------------


@pytest.mark.slow
def test_entries_that_are_damaged_are_found_out_anew() -> None:
    notes: list[str] = []
    system = of(TEXT)
    found, expected = dependences(system), outcomes(verify(system, SHORT))
    for damage in (
        b"no json",
        b"[]",
        b'{"alike": 3}',
        b'{"alike": [{}]}',
        b'{"alike": [{"names": [], "key": "x", "layout": null, "verdict": 1}]}',
    ):
        cache = VerdictCache(MemoryStore(), notes.append)
        verified(cache, system)
        for claim in found.claims:
            cache.store.put(found.asked(claim), damage)
        again = verified(cache, system)
        assert not kept(again)
        assert outcomes(again) == expected
    assert notes


def test_what_is_kept_of_a_claim_is_nothing_else_than_a_verdict() -> None:
    cache, system = new_cache(), of(TEXT)
    verified(cache, system)
    found = dependences(system)
    claim = next(c for c in found.claims if c.kind is ClaimKind.PROPERTY)
    data = json.loads(cache.store.get(found.asked(claim)) or b"")
    wrong: object
    for wrong in (7, "holds", {"struct": "verdicts.Verdict"}, {"struct": "os.system"}, []):
        data["alike"][0]["verdict"] = wrong
        cache.store.put(found.asked(claim), json.dumps(data).encode())
        assert claim not in cache.known(found)
        cache.store.put(found.asked(claim), json.dumps(data).encode())
