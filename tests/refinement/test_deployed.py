"""Deployed robots do what the rules allow, on networks with every fault. [REPLAY] (R-COMMIT)"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from koord.refinement import running
from koord.refinement.cases import Case, SchedulePolicy, Target, Tried, generated, tried
from koord.refinement.hearing import DisagreementError, Heard
from koord.refinement.instrumented_robot import InstrumentedRobot
from koord.refinement.reports import Acted
from koord.refinement.running import ready
from koord.runtime.chaos.network import CALM, CHAOS, LOSS, Faults
from koord.runtime.chaos.unreliable import Unreliable
from koord.runtime.compile import compiled
from koord.runtime.deploy.member import Member
from koord.runtime.engine import Deployed, Unheard
from koord.runtime.proposals import (
    Admitted,
    Attempt,
    Decision,
    EventFault,
    Proposal,
    decide,
)
from koord.runtime.robot import Status
from koord.syntax import core
from koord.syntax.faults import FaultKind
from koord.syntax.system import dealt
from tests.loading import example_files
from tests.refinement.running import agrees, program, seeds, sources
from tests.runtime.hub import Hub
from tests.sampling import first

EXAMPLES = Path(__file__).resolve().parents[2] / "specs/examples"

COUNT = (
    "allwrite:\n  int sum = 0\nlocal:\n  int mine = 0\n"
    "Add:\n  eff:\n    atomic:\n      sum = sum + 1\n    mine = sum\n    stdout << mine\n"
)


def expedition(
    text: str,
    *,
    target: Target = Target.NETWORK,
    faults: Faults = CALM,
    robots: int = 3,
    rounds: int = 12,
    seed: int = 1,
) -> Tried:
    system = dealt(program(text), robots)
    case = Case(
        system, sources(text), SchedulePolicy.DEPLOYED, rounds, seed, target=target, faults=faults
    )
    return tried(case)


# --- over a simulated network ---------------------------------------------------------------------


@pytest.mark.parametrize("count", first(1, [6, 50]))
@pytest.mark.parametrize("faults", [CALM, LOSS, CHAOS], ids=["calm", "loss", "chaos"])
def test_generated_programs_are_refined_by_deployed_robots(faults: Faults, count: int) -> None:
    found = [tried(generated(seed, 8, Target.NETWORK, faults)) for seed in seeds(count)]
    assert [(o.case.seed, o.refused, o.crash) for o in found if o.failed] == []
    assert sum(o.judged.steps for o in found if o.judged is not None) > 5 * len(found)


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [8, 30])
@pytest.mark.parametrize("block", range(5))
def test_many_generated_programs_are(rounds: int, block: int) -> None:
    tried_here = seeds(1_500)[block::5]
    found = [tried(generated(seed, rounds, Target.NETWORK, CHAOS)) for seed in tried_here]
    assert [(o.case.seed, o.refused, o.crash) for o in found if o.failed] == []


@pytest.mark.parametrize("seed", [1302718217, 1537810351, 1924014660, 345512145, 1182021441])
def test_what_was_found_once_is_not_found_again(seed: int) -> None:
    """Robots that come back to a run that is over, or with a proposal that is still pending.

    And: what an event did that is known to have run rounds ago; a model's fault.
    """
    outcome = tried(generated(seed, 8, Target.NETWORK, CHAOS))
    assert (outcome.refused, outcome.crash) == (None, "")


@pytest.mark.parametrize("name", ["task", "lineform", "fischer", "cars_and_drones", "waypoints"])
def test_examples_are(name: str) -> None:
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    outcome = expedition(text, faults=CHAOS, robots=4, rounds=20)
    assert (outcome.refused, outcome.crash) == (None, "")
    assert outcome.ran is not None
    assert outcome.ran.gave_up is None
    assert len(outcome.ran.trace.recording.rounds) == 20


@pytest.mark.slow
@pytest.mark.parametrize("file", example_files(), ids=lambda path: path.stem)
def test_every_example_is(file: Path) -> None:
    for robots, faults in ((2, LOSS), (4, CHAOS)):
        outcome = expedition(file.read_text("utf-8"), faults=faults, robots=robots, rounds=30)
        assert (outcome.refused, outcome.crash) == (None, "")


@pytest.mark.parametrize("faults", [CALM, CHAOS], ids=["calm", "chaos"])
def test_robots_stop_alone_and_together(faults: Faults) -> None:
    """[STOP]"""
    together = "local:\n  int n = 0\nE:\n  eff:\n    n = n + 1\n    if n > pid: trystop()\n"
    for text in (together, together.replace("trystop()", "stop")):
        outcome = expedition(text, faults=faults, rounds=40)
        agrees(outcome)
        assert outcome.ran is not None
        last = outcome.ran.trace.configurations[-1]
        assert {robot.status for robot in last.robots} == {Status.STOPPED.value}


def test_a_run_in_chaos_has_skips_and_output() -> None:
    outcome = expedition(COUNT, faults=CHAOS, rounds=30)
    agrees(outcome)
    assert outcome.ran is not None
    trace = outcome.ran.trace
    assert len(trace.recording.rounds) == 30
    turns = [round_.events[number % 3] for number, round_ in enumerate(trace.recording.rounds)]
    assert None in turns  # whose turn it was came too late
    assert len(trace.outputs) == sum(
        event is not None for round_ in trace.recording.rounds for event in round_.events
    )


# --- in processes ---------------------------------------------------------------------------------


def test_processes_over_udp_are_judged() -> None:
    outcome = expedition(COUNT, target=Target.UDP, rounds=10)
    agrees(outcome)
    assert outcome.ran is not None
    assert len(outcome.ran.trace.recording.rounds) == 10
    assert len(outcome.ran.trace.outputs) == 10


@pytest.mark.slow
@pytest.mark.parametrize("faults", [LOSS, CHAOS], ids=["loss", "chaos"])
@pytest.mark.parametrize("name", ["task", "sum_of_ids", "leader_elect"])
def test_processes_on_a_bad_network_are(name: str, faults: Faults) -> None:
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    outcome = expedition(text, target=Target.UDP, faults=faults, robots=5, rounds=30)
    assert (outcome.refused, outcome.crash) == (None, "")


# --- what is wrong is found -----------------------------------------------------------------------


def test_a_robot_that_acts_though_it_was_not_let_through_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """[ATOMIC]"""
    honest = Member._act

    def wrongly(self: Member, kept: Admitted | None, changed: dict[str, Any]) -> None:
        event = kept if kept is not None else Admitted(self.robot.pid, 0)
        honest(self, event if self.robot._buffers else kept, changed)

    monkeypatch.setattr(Member, "_act", wrongly)
    outcome = expedition(COUNT)
    assert outcome.refused is not None
    assert outcome.refused.rule == "ENV-TRANS"


def test_output_that_does_not_leave_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """[OUTPUT]"""
    monkeypatch.setattr(InstrumentedRobot, "_tell_output", lambda self, event: None)
    outcome = expedition(COUNT)
    assert outcome.refused is None  # nobody saw it, so nothing is known
    silent = COUNT.replace("stdout << mine", "stdout << pid")

    def other(self: InstrumentedRobot, event: int | None) -> None:
        if self._proposal is not None:
            self._witness.kept(self._proposal.round, self.robot, None)

    monkeypatch.setattr(InstrumentedRobot, "_tell_output", other)
    refused = expedition(silent).refused
    assert refused is not None
    assert refused.rule == "OUTPUT"


def test_two_decisions_of_one_round_are_noticed() -> None:
    """(I-AGREE)"""
    one, other = (Decision(3, (Admitted(i, None),), (), ()) for i in range(2))
    with pytest.raises(DisagreementError) as caught:
        Heard.of([(0, [Acted(one)]), (2, [Acted(other)])])
    assert str(caught.value) == "robots 0 and 2 acted on different decisions in round 4"


def test_a_wrong_program_is_refused_wherever_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrongly(program: core.Program) -> str:
        return compiled(program).replace("sum + 1", "sum + 2")

    monkeypatch.setattr(running, "compiled", wrongly)
    for target in Target:
        refused = expedition(COUNT, target=target, rounds=3).refused
        assert refused is not None
        assert refused.rule in ("EVENT-TRANS", "ENV-TRANS", "OUTPUT")


# --- bad networks ---------------------------------------------------------------------------------


def test_an_unreliable_network_loses_doubles_and_delays() -> None:
    hub, now = Hub(2), [0.0]
    faults = Faults(loss=0.3, duplication=0.2, least_delay_s=0.01, most_delay_s=0.05)
    there = Unreliable(hub.transport(1), faults, 3, lambda: now[0])
    for k in range(200):
        hub.transport(0).send(1, bytes([k]))
    assert there.receive(0.0) == []
    came: list[int] = []
    while now[0] < 0.06:
        now[0] += 0.001
        came += [datagram[0] for datagram in there.receive(0.0)]
    assert 120 < len(set(came)) < 160
    assert len(set(came)) + 10 < len(came)
    assert came != sorted(came)


def test_a_network_that_is_cut_is_silent_for_a_while() -> None:
    hub, now = Hub(2), [0.0]
    faults = Faults(least_delay_s=0.0, most_delay_s=0.0, cuts_per_s=1e9, cut_s=0.5)
    there = Unreliable(hub.transport(1), faults, 3, lambda: now[0])
    for at in (0.1, 0.2):
        now[0] = at
        hub.transport(0).send(1, b"?")
        assert there.receive(0.0) == []


# --- the engine, with proposals that are lost -----------------------------------------------------


def test_lost_proposals_are_skips() -> None:
    """[SKIP]"""
    text = "local:\n  int n = 0\nUp:\n  eff:\n    n = n + 1\n"
    system = dealt(program(text), 3)
    for faults in (LOSS, replace(LOSS, loss=0.0, crashes_per_s=1.0)):
        case = Case(system, sources(text), SchedulePolicy.DEPLOYED, 40, 5, faults=faults)
        outcome = tried(case, ready(system.program))
        agrees(outcome)
        assert outcome.ran is not None
        rounds = outcome.ran.trace.recording.rounds
        skips = sum(event is None for round_ in rounds for event in round_.events)
        assert 5 < skips < 60


def test_urgent_proposals_are_not_lost() -> None:
    """[SKIP] (R-OWED)"""
    text = "local:\n  int n = 0\nurgent Up:\n  eff:\n    n = n + 1\n"
    system = dealt(program(text), 3)
    case = Case(
        system, sources(text), SchedulePolicy.DEPLOYED, 10, 5, faults=replace(LOSS, loss=1.0)
    )
    outcome = tried(case)
    agrees(outcome)
    assert outcome.ran is not None
    assert all(None not in round_.events for round_ in outcome.ran.trace.recording.rounds)


def test_a_robot_that_is_away_is_away_for_some_rounds() -> None:
    schedule = Unheard(Deployed(), Random(1), loss=0.0, crashes=True)
    heard = "".join("x" if schedule.hears(Proposal(0, k)) else "." for k in range(200))
    assert 1 <= max(map(len, heard.split("x"))) <= 12
    assert "x" in heard
    assert "..." in heard


# --- models that fault ----------------------------------------------------------------------------

MODEL = (
    "using Wall:\n  sensors:\n    int gap = 3\n  environment:\n    gap = gap - gap / gap\n"
    "local:\n  int n = 0\nUp:\n  eff:\n    n = n + 1\n"
)


def test_a_model_that_may_fault_obliges_its_robot() -> None:
    """(R-OWED) [ENV-TRANS]"""
    (made,) = ready(program(MODEL)).classes
    assert made.MODEL_MAY_FAULT
    assert made.owes()
    sure = MODEL.replace("gap - gap / gap", "choose(0, 4) + 1")
    (harmless,) = ready(program(sure)).classes
    assert not harmless.MODEL_MAY_FAULT
    assert not harmless.owes()
    turned = MODEL.replace("gap - gap / gap", "choose(4, gap)")
    assert ready(program(turned)).classes[0].MODEL_MAY_FAULT


@pytest.mark.parametrize("seed", range(4))
def test_the_fault_of_a_model_ends_the_run_before_the_round(seed: int) -> None:
    """[FAULT]: nobody runs in the round that it was told in."""
    outcome = expedition(MODEL, faults=CHAOS, rounds=20, seed=seed)
    agrees(outcome)
    assert outcome.ran is not None
    assert outcome.ran.fault_place == "app.krd:5:23"
    fault = outcome.ran.trace.configurations[-1].fault
    assert fault is not None
    assert fault.robot == 0


def test_of_several_models_the_first_robot_s_counts() -> None:
    def stumbled(robot: int) -> Proposal:
        fault = EventFault(FaultKind.DIVISION, f"app.krd:{robot}:1")
        return Proposal(robot, 3, (Attempt(None, fault=fault),))

    proposals: Mapping[int, Proposal] = {
        0: Proposal(0, 3, (Attempt(0),)),
        1: stumbled(1),
        2: stumbled(2),
    }
    decided = decide(3, proposals, (2, 0, 1))
    assert decided.ran == ()
    assert decided.fault is not None
    assert decided.fault.robot == 1
