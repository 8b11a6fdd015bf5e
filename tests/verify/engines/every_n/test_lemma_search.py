"""Lemmas that are found from counterexamples to induction. [T-EVERY-N]"""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.sampling.reached import reached
from koord.syntax import core
from koord.syntax.core import Const, Home
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.engine import Purpose, Task
from koord.verify.engines.every_n import lemma_search
from koord.verify.engines.every_n.conditions import asked_of
from koord.verify.engines.every_n.disjunctions import (
    Samples,
    canonical,
    implied,
    is_false,
    lemma,
)
from koord.verify.engines.every_n.engine import EveryNEngine
from koord.verify.engines.every_n.kinds_of_integers import ROBOT, KindsOfIntegers
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.lemma_search import infer_from_counterexamples
from koord.verify.engines.every_n.literals import Between, Existence, Literal, Snapshot
from koord.verify.engines.every_n.looking import Looking
from koord.verify.engines.every_n.proving import Inferred
from koord.verify.engines.every_n.questions import GENEROUS, SPARING, Means, Step
from koord.verify.ledger import Ledger
from koord.verify.reduction.problems import plain_problem
from koord.verify.verdicts import Bounds
from tests.loading import PROTOCOLS, program_of, protocol_text
from tests.sampling import but_slow, first
from tests.verify.engines.every_n.asking import broken, proved, system_of

#: Numbers go round a ring, in entries that their robots alone write; the greatest comes back.
RING = """
allread:
    int[] sent = -1
local:
    bool leads = false
def fun before(int i) -> int:
    if i > 0: return i - 1
    return numAgents - 1
Send:
    pre: sent[pid] == -1
    eff: sent[pid] = pid
Pass:
    pre: sent[before(pid)] > pid
    eff: sent[pid] = sent[before(pid)]
Lead:
    pre: sent[before(pid)] == pid
    eff: leads = true
invariant One: forall i, j: leads@i and leads@j implies i == j
"""

#: Each key is at one robot, or on its way to one.
STORE = """
param int keys = 3
allwrite:
    int[keys] heading
    int wanted = 0
    int wanting = 0
local:
    bool[keys] has
init:
    for k = 0, keys:
        heading[k] = -1
        has[k] = pid == 0
Want:
    eff:
        atomic:
            wanted = (wanted + 1) % keys
            wanting = pid
Send:
    pre: has[wanted]
    eff:
        atomic:
            has[wanted] = false
            heading[wanted] = wanting
Receive:
    eff:
        atomic:
            for k = 0, keys:
                if heading[k] == pid:
                    heading[k] = -1
                    has[k] = true
invariant Exclusive:
    forall i, j: forall k in 0, keys: i != j implies not (has@i[k] and has@j[k])
"""

#: The environment moves what no event may: between rounds only.
MOVED = """
using Door:
    sensors:
        int opened = 0
    environment:
        opened = opened + 1
allwrite:
    int seen = 0
Look:
    pre: Door.opened > 0
    eff:
        atomic: seen = Door.opened
invariant Never: seen <= 1
invariant Shut: forall i: Door.opened@i <= 1
"""

#: Nothing changes, and what the robots start with is not what the claim says.
LATE = """
local:
    bool on = false
    bool done = false
Start:
    pre: not on
    eff: on = true
End:
    pre: on
    eff: done = true
invariant Never: forall i: not done@i
"""


#: What the samples of few robots never show is so with many.
MANY = """
local:
    bool big
    bool done = false
init: big = pid > 4
Finish:
    pre: big
    eff: done = true
invariant Never: forall i: not done@i
"""


def found(text: str, seconds: float = 20.0) -> Inferred:
    system = system_of(text)
    effort = Effort.of_seconds(seconds)
    return infer_from_counterexamples(system, claims_of(system), (), Deadline(), effort, GENEROUS)


@pytest.mark.parametrize(
    ("name", "claims"),
    first(
        4,
        [
            ("claim", {"Exclusive", "no fault"}),
            ("lock_server", {"Exclusive", "no fault"}),
            ("lockserv", {"Exclusive", "no fault"}),
            # What a sensor is bounded by, and that all robots have read the same.
            ("leader_lease", {"OneLeader", "no fault"}),
            # Numbers pass those that are smaller: a third robot stands between.
            pytest.param(
                "ring_election", {"OneLeader", "Highest", "no fault"}, marks=pytest.mark.slow
            ),
            # What each robot has told each other.
            pytest.param("ricart_agrawala", {"Exclusive", "no fault"}, marks=pytest.mark.slow),
            ("semaphore", {"Room", "Few", "no fault"}),
            ("sharded_store", {"OneOwner", "Current", "no fault"}),
            ("ticket", {"Exclusive", "Waits", "no fault"}),
            # What a guard has seen: all of a quorum have voted for a value, or more than half.
            pytest.param("consensus_epr", {"Agree", "no fault"}, marks=pytest.mark.slow),
            ("majority_election", {"OneLeader", "no fault"}),
            ("quorum_leader_election", {"OneLeader", "no fault"}),
            ("toy_consensus", {"Agree", "no fault"}),
            # What the claim asks of each response was asked when it was sent.
            ("client_server_ae", {"Asked", "no fault"}),
            # Whoever aborts has a reason: there is a robot that voted no, or failed.
            ("two_phase_commit", {"Agree", "Unanimous", "Reasoned", "no fault"}),
        ],
    ),
)
def test_protocols_are_shown_for_every_number_of_robots(name: str, claims: set[str]) -> None:
    text = protocol_text(name)
    given = found(text)
    assert {claim.name for claim in given.proved} == claims
    # They are Koord, and with them the claims are inductive.
    lemmas = "".join(f"invariant L{k}: {c.name}\n" for k, c in enumerate(given.invariants))
    assert proved(text + "\n" + lemmas) >= claims


def test_the_greatest_number_on_a_ring_is_the_only_one_that_comes_back() -> None:
    given = found(RING)
    assert {claim.name for claim in given.proved} == {"One", "no fault"}
    assert 1 <= len(given.invariants) <= 8


def test_elements_of_arrays_are_spoken_of_at_any_index() -> None:
    given = found(STORE)
    assert {claim.name for claim in given.proved} == {"Exclusive", "no fault"}
    assert any("forall k in 0, 3" in claim.name for claim in given.invariants)


#: Protocols with mistakes, and those of them that are soon looked through.
BROKEN = sorted(PROTOCOLS.glob("broken/*.krd"))
SOON = {
    "barrier_any",
    "charging_queue_lets_go",
    "claim_marks_late",
    "client_server_ae_answers_any",
    "coherence_msi_no_invalidation",
    "decentralized_lock_keeps",
    "dekker_turn_alone",
    "dock_allocation_frees_on_arrival",
}


@pytest.mark.parametrize(
    "path",
    first(3, but_slow([path for path in BROKEN if path.stem not in SOON], BROKEN)),
    ids=lambda p: p.stem,
)
def test_what_some_run_breaks_is_never_proved(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    shown = {claim.name for claim in found(text, 5.0).proved}
    for count in (2,) if "param int numAgents" in text else (2, 3):
        assert not shown & broken(text, count, rounds=8)


def test_what_breaks_after_rounds_only_is_not_proved() -> None:
    assert {"Never", "Shut"}.isdisjoint(claim.name for claim in found(MOVED).proved)
    assert broken(MOVED, 1, rounds=4) >= {"Shut"}


def test_what_breaks_in_the_second_round_is_not_proved() -> None:
    assert {claim.name for claim in found(LATE).proved} <= {"no fault"}


def test_what_only_many_robots_break_is_not_proved() -> None:
    assert {claim.name for claim in found(MANY).proved} <= {"no fault"}
    assert broken(MANY, 6, rounds=2) == {"Never"}


def test_nothing_is_proved_where_solvers_are_not_asked() -> None:
    system = system_of(protocol_text("lockserv"))
    nothing = infer_from_counterexamples(
        system, claims_of(system), (), Deadline(), Effort.of_seconds(0), SPARING
    )
    assert not nothing.proved


def test_what_was_too_much_for_little_work_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    text = protocol_text("lock_server")
    monkeypatch.setattr(lemma_search, "_PATIENCE", (1,))
    assert not found(text).proved
    monkeypatch.setattr(lemma_search, "_PATIENCE", (1, 1_000_000))
    assert {claim.name for claim in found(text).proved} == {"Exclusive", "no fault"}


def test_what_solvers_leave_open_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lemma_search, "_PATIENCE", (1,))
    system = system_of(protocol_text("lock_server"))
    for claim in claims_of(system):
        effort = Effort.of_seconds(5)
        given = infer_from_counterexamples(system, [claim], (), Deadline(), effort, GENEROUS)
        assert not given.proved


def test_lemmas_that_nobody_needs_are_left_out() -> None:
    text = protocol_text("lock_server")
    lemmas = [claim.name for claim in found(text).invariants]
    system = system_of(text + "".join(f"\ninvariant: {x}" for x in [*lemmas, "forall i: i >= 0"]))
    *claims, needed, idle, fault = claims_of(system)
    step = Step(system, Means(Deadline(), Effort.of_seconds(20), GENEROUS, 0))
    assert step.fewest([*claims, fault], [needed, idle]) == [needed]
    # Nothing is left out of what does not show itself.
    assert step.fewest([*claims, fault], [idle]) == [idle]


def snapshots(
    program: core.Program, language: Language, turns: int, robots: int = 2
) -> list[Snapshot]:
    """What is looked at of the configurations that a few robots reach."""
    few = dealt(program, robots)
    asked = asked_of(language.conditions, language.size)
    return [language.sampled(c, asked(few, c)) for c in reached(few, turns)]


# --- samples ----------------------------------------------------------------------------------


def test_samples_are_of_all_that_a_small_system_reaches() -> None:
    program = program_of(protocol_text("lock_server"))
    seen = reached(dealt(program, 2), 400)
    # Nobody has the lock, one of two has it.
    assert len(seen) == 3
    assert all(configuration.fault is None for configuration in seen)


def test_disjunctions_hold_in_all_samples_and_not_where_they_are_wanted() -> None:
    program = program_of(protocol_text("lock_server"))
    language = Language.of_program(program)
    seen = snapshots(program, language, 400)
    samples = Samples.of(language, seen, language.rows)
    # Both have the lock.
    wrong = snapshots(program, language, 400)[0]
    wrong.robots = {robot: (True,) for robot in wrong.robots}
    disjunctions = {
        canonical(language, x) for row in language.rows(wrong) for x in samples.against(wrong, row)
    }
    assert disjunctions
    for x in disjunctions:
        assert is_false(language, x, wrong)
        assert not any(is_false(language, x, here) for here in seen)
    said = {lemma(Quoting.of(program), language, x).name for x in disjunctions}
    assert "forall i, j: i != j and holds@i implies not holds@j" in said


def test_that_there_is_a_robot_is_said_where_somebody_asks() -> None:
    program = program_of(protocol_text("two_phase_commit"))
    language = Language.of_program(program)
    there = [n for n, x in enumerate(language.literals) if isinstance(x, Existence)]
    assert there
    seen = snapshots(program, language, 400)
    for here in seen:
        for n in there:
            x = language.literals[n]
            assert isinstance(x, Existence)
            rows = ((robot, None, None, 0) for robot in here.robots)
            truth = any(x.witness.look(here, row) is True for row in rows)
            assert x.look(here, (0, 1, None, 0)) is truth
    said = {lemma(Quoting.of(program), language, (n,)).name for n in there}
    assert "exists j: vote[j] == no" in said
    # Beside two robots that are spoken of there is a third.
    apart = next(n for n, x in enumerate(language.literals) if x.of == 2)
    assert "exists m: " in lemma(Quoting.of(program), language, (apart, there[0])).name
    other = Language.of_program(program_of(protocol_text("lockserv")))
    assert not any(isinstance(x, Existence) for x in other.literals)


def test_what_follows_at_once_is_not_tried_as_well() -> None:
    language = Language.of_program(program_of(protocol_text("two_phase_commit")))
    named = {
        lemma(Quoting.of(program_of(protocol_text("two_phase_commit"))), language, (n,)).name: n
        for n in range(len(language.literals))
    }
    yes, open_ = named["forall i: vote[i] == yes"], named["forall i: vote[i] != open"]
    some = named["exists j: vote[j] == yes"]
    assert implied(language, (open_,), (yes,))
    assert implied(language, (some,), (yes,))
    assert implied(language, (open_, some), (yes,))
    assert not implied(language, (yes,), (open_,))
    assert not implied(language, (yes,), (some,))
    assert not implied(language, (open_,), (yes, some))


@pytest.mark.parametrize(
    "name",
    [
        "two_phase_commit",
        "sharded_store",
        "ticket",
        "toy_consensus",
        "ricart_agrawala",
        "ring_election",
        "token_ring",
    ],
)
def test_truths_are_looked_at_together_as_one_by_one(name: str) -> None:
    program = program_of(protocol_text(name))
    language = Language.of_program(program)
    looking = Looking(language)
    for robots in (2, 3):
        for here in snapshots(program, language, 60, robots):
            for rows in (language.rows, language.triples):
                for row, truths in zip(rows(here), looking.truths(here, rows(here)), strict=True):
                    for n, x in enumerate(language.literals):
                        assert bool(truths >> n & 1) is (x.look(here, row) is True)


@pytest.mark.parametrize("name", ["client_server_ae", "distributed_lock"])
def test_what_is_false_of_a_robot_is_known_whoever_the_others_are(name: str) -> None:
    program = program_of(protocol_text(name))
    language = Language.of_program(program)
    met = snapshots(program, language, 40, 3)
    samples = Samples.of(language, met, language.rows)
    for here in met[:12]:
        for row in (*language.rows(here), *language.triples(here)):
            false = [n for n, x in enumerate(language.literals) if x.look(here, row) is False]
            assert samples._false(here, row) == false


@pytest.mark.parametrize("name", ["client_server_ae", "raft_votes", "mesi"])
def test_conditions_that_are_known_are_as_if_worked_out_anew(name: str) -> None:
    program = program_of(protocol_text(name))
    language = Language.of_program(program)
    assert language.conditions
    asked = asked_of(language.conditions, language.size)
    met = set()
    for robots in (2, 3):
        few = dealt(program, robots)
        for here in reached(few, 100):
            looked = asked(few, here)
            assert looked == asked_of(language.conditions, language.size)(few, here)
            met |= set(looked.items())
    # Of something it is said that it is so, and that it is not.
    assert any((at, True) in met and (at, False) in met for at, _ in met)


def test_what_robots_have_of_each_other_is_told_apart() -> None:
    program = program_of(protocol_text("ricart_agrawala"))
    language = Language.of_program(program)
    here = snapshots(program, language, 60)[0]
    here.pairs = {(0, 0): (False,), (0, 1): (True,), (1, 0): (False,), (1, 1): (False,)}
    said = {
        lemma(Quoting.of(program), language, (n,)).name: x.look(here, (0, 1, None, 0))
        for n, x in enumerate(language.literals)
        if isinstance(x, Literal) and x.left.owner
    }
    assert said == {
        "forall i, j: i != j implies lets[i][j]": True,
        "forall i, j: i != j implies not lets[i][j]": False,
        "forall i, j: i != j implies lets[j][i]": False,
        "forall i, j: i != j implies not lets[j][i]": True,
    }


@pytest.mark.slow
def test_what_robots_have_of_each_other_is_spoken_of_first() -> None:
    """What is said of all others costs more: it is one more quantifier."""
    shown = found(protocol_text("ricart_agrawala"))
    assert {claim.name for claim in shown.proved} == {"Exclusive", "no fault"}
    lemmas = {claim.name for claim in shown.invariants}
    # What it finds besides, as that nobody whom a holder waits for has let it, hangs on models.
    assert lemmas >= {
        "forall i: 0 <= whose@i",
        "forall i: whose@i < numAgents",
        "forall i, j: i != j and lets[j][i] implies not lets[i][j]",
    }
    assert all(name.count("forall") == 1 and "exists" not in name for name in lemmas)


def test_who_stands_between_two_on_a_ring_is_said_in_koord() -> None:
    program = program_of(protocol_text("ring_election"))
    language = Language.of_program(program)
    assert language.ring
    here = snapshots(program, language, 60, 3)[0]
    for row in language.triples(here):
        i, j, h, _ = row
        assert j is not None
        assert h is not None
        forth = Between(True).look(here, row)
        # One goes round from i, step by step, until j.
        way = [(i + step) % 3 for step in range(1, 3)]
        assert forth is (h in way[: way.index(j)])
        assert Between(False).look(here, row) is not forth
    between = next(n for n, x in enumerate(language.literals) if x == Between(False))
    third = next(n for n, x in enumerate(language.literals) if x.of == 4)
    said = lemma(Quoting.of(program), language, canonical(language, (between, third))).name
    assert said.startswith("forall i, j, h: ")
    # Whoever is called i, j or h: it is one lemma.
    same = {
        canonical(
            language, tuple(sorted(n for n in (renamed[between], renamed[third]) if n is not None))
        )
        for renamed in language.renamed
    }
    assert same == {canonical(language, (between, third))}
    other = Language.of_program(program_of(protocol_text("ticket")))
    assert not other.ring
    assert not any(isinstance(x, Between) for x in other.literals)


def test_integers_that_meet_are_of_one_kind() -> None:
    program = program_of(protocol_text("ticket"))
    kinds = KindsOfIntegers.of(program)
    ticket = kinds.kind((Home.LOCAL, 0, program.agents[0].locals[1].variable.slot, ()))
    assert ticket == kinds.kind((Home.ALLWRITE, 0, 0, ()))
    assert ticket == kinds.kind((Home.ALLWRITE, 0, 1, ()))
    assert ticket != kinds.kind(ROBOT)
    assert kinds.is_ordered(ticket)
    initial = program.allwrite[0].initial
    assert isinstance(initial, Const)
    assert initial.value in kinds.constants(ticket)


def test_what_robots_have_counted_is_compared_with_what_all_have() -> None:
    """Nothing assigns one counter to the other: both are said to be ten at most."""
    text = """
    allwrite:
        int n = 0
    local:
        int k = 0
    Up:
        pre: n < 10
        eff:
            atomic:
                n = n + 1
                k = k + 1
    invariant Few: n <= 10
    invariant Own: forall i: k@i <= 10
    """
    shown = found(text)
    assert {claim.name for claim in shown.proved} == {"Few", "Own", "no fault"}
    assert {claim.name for claim in shown.invariants} == {"forall i: k@i <= n"}
    faster = text.replace("k = k + 1", "k = k + 2")
    assert {claim.name for claim in found(faster).proved} == {"Few", "no fault"}
    assert "Own" in broken(faster, 1, rounds=10)


@pytest.mark.parametrize(("seconds", "seeds"), [(None, [0, 1, 2]), (1.0, [0])])
def test_who_is_asked_alone_tries_its_luck_again(
    seconds: float | None, seeds: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a solver comes upon first decides which lemmas are found."""
    asked = []

    def nothing(*about: object) -> Inferred:
        asked.append(about[-1])
        return Inferred((), ())

    monkeypatch.setattr(lemma_search, "infer_from_counterexamples", nothing)
    system = system_of(RING)
    ledger = Ledger(plain_problem(system), Bounds(), Deadline(), claims_of(system))
    EveryNEngine().work(ledger, Task(Purpose.INFER, seconds=seconds, candidates=0))
    assert asked == seeds
