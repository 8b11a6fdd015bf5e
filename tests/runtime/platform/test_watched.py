"""Claims are watched while a run goes on: by each robot, and by who hears of all. (P-WATCH)"""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import koord
from koord.cli.main import main
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import watched
from koord.runtime.deploy.member import Untimed
from koord.runtime.deploy.watching import (
    Breach,
    FleetMonitor,
    LastingState,
    RobotState,
    continued,
    joined,
)
from koord.runtime.robot import Forwarding, Robot
from koord.runtime.store import AgreedStore
from koord.syntax.source import Span

#: Two points go from x = 1 and x = 2 to x = 3, and count together to ten.
PROGRAM = """\
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos target
    contract Stays:
        requires: true
        ensures: psn'.x <= {furthest}

allwrite:
    int n = 0

local:
    int k = 0

init:
    Motion.target = pos(3.0, 0.0, 0.0)

Up:
    pre: n < 10
    eff:
        atomic:
            n = n + 1
            k = k + 1

Done:
    pre: n >= 10 and Motion.reached
    eff: stop

invariant Few: n <= {most}
invariant Own: forall i: k@i <= {own}
invariant All: forall i: k@i <= 100
"""

CONFIGURATION = """\
agents:
  - {pid: 0, on_device: point, position: [1, 0, 0]}
  - {pid: 1, on_device: point, position: [2, 0, 0]}
devices:
  point: {bot_type: IDEAL, planner: STRAIGHT}
world: {bounds: {low: [0, 0, 0], high: [5, 5, 1]}}
"""


def _program(furthest: float = 3.0, most: int = 10, own: int = 10) -> koord.Source:
    return koord.Source("count.krd", PROGRAM.format(furthest=furthest, most=most, own=own))


def _deployed(program: koord.Source, **options: Any) -> koord.Deployed:
    config = koord.read_configuration(koord.Source("count.yaml", CONFIGURATION))
    return koord.deploy(program, config, as_fast_as_possible=True, rounds=60, **options)


def test_what_holds_is_told_of_nobody() -> None:
    deployed = _deployed(_program())
    assert deployed.ok
    assert deployed.broken == ()
    assert deployed.unwatched == ()


def test_what_does_not_hold_is_told_with_robot_round_and_text() -> None:
    deployed = _deployed(_program(furthest=2.5, most=7, own=0))
    assert deployed.is_complete
    assert not deployed.ok
    found = {one.key: one for one in deployed.broken}
    assert found.keys() == {
        ("contract Stays", (0,)),
        ("contract Stays", (1,)),
        ("invariant Few", ()),
        ("invariant Own", (0,)),
        ("invariant Own", (1,)),
    }
    stays = found["contract Stays", (1,)]
    assert stays.place == "count.krd:7:5"
    assert stays.text.splitlines()[-1].strip() == "ensures: psn'.x <= 2.5"
    # A point moves a little less than 0.1 m in each round: after six of them that of x = 2 is
    # beyond 2.5, and that of x = 1 after sixteen.
    assert (stays.round, found["contract Stays", (0,)].round) == (5, 15)
    # One robot after the other counts: it is 8 when round 8 begins, for each that looks.
    few = found["invariant Few", ()]
    assert few.round == 8
    last = max(status.round for status in deployed.statuses.values())
    assert few.times <= last - few.round + 1
    # It stays ten: in each round since it is found again.
    assert few.times >= 40
    # In some round the first robot has counted, and the other one in the next.
    rounds = sorted(found["invariant Own", (pid,)].round for pid in (0, 1))
    assert rounds[0] == 1
    document = json.loads(deployed.to_json())
    assert {one["claim"] for one in document["broken"]} == {claim for claim, _ in found}


@pytest.mark.slow
def test_verdicts_that_rest_on_a_broken_contract_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, config = tmp_path / "count.krd", tmp_path / "count.yaml"
    text = (
        _program(furthest=2.5).text + "invariant Near at round: forall i: Motion.psn@i.x <= 2.5\n"
    )
    program.write_text(text + "assume: forall i: Motion.psn@i.x <= 2.5\n")
    config.write_text(CONFIGURATION)
    assert main(["verify", str(program), "--robots", "2", "--rests-on", "--json"]) == 0
    report = tmp_path / "verdicts.json"
    report.write_text(capsys.readouterr().out)
    flags = ["--all-local", "--as-fast-as-possible", "--rounds", "60", "--rests-on", str(report)]
    assert main(["deploy", str(program), str(config), *flags]) == 1
    out = capsys.readouterr().out
    assert "contract Stays of robot 1 did not hold in round " in out
    assert "        ensures: psn'.x <= 2.5\n" in out
    rests = [line for line in out.splitlines() if "rests on it" in line]
    assert rests
    assert all("Near" in line for line in rests)


@pytest.mark.parametrize(
    ("text", "story"),
    [
        ("{}", "it is no report of verdicts"),
        ("\udcff", "it is no report of verdicts"),
        ('{"version": 1, "reports": []}', "it has no report on count.krd"),
    ],
)
def test_what_is_no_report_of_verdicts_is_refused(tmp_path: Path, text: str, story: str) -> None:
    report = tmp_path / "verdicts.json"
    report.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(koord.KoordError, match=story):
        _deployed(_program(), rests_on=report)


# --- the monitor of all robots ------------------------------------------------------------------


def _monitor(own: int) -> tuple[FleetMonitor, type[Robot]]:
    program = koord.load(_program(own=own)).core
    classes = loaded(compiled(program))
    claims = watched(program, Fraction(0))
    host = _Answers()
    return FleetMonitor(claims, classes, (0, 0), 0.1, host), classes[0]


class _Answers(Untimed, Forwarding):
    """A host that nobody asks."""

    def __init__(self) -> None:
        super().__init__(self)


def _state(made: type[Robot], round_: int, pid: int, k: int) -> RobotState:
    robot = made(pid, (0, 0), 0.1, _Answers())
    vars(robot)["k"] = k
    return RobotState.of(robot, round_, AgreedStore(made.SHARED, 2))


def _telling(made: type[Robot], round_: int, pid: int, k: int) -> RobotState:
    """A state that tells of the store as well."""
    store = AgreedStore(made.SHARED, 2).snapshot()
    return replace(_state(made, round_, pid, k), shared=store)


def _found(monitor: FleetMonitor) -> tuple[Breach, ...]:
    return monitor.breaches.all


def test_a_round_is_looked_at_once_all_have_told() -> None:
    monitor, made = _monitor(own=5)
    monitor.hear(0, _state(made, 3, 0, 6))
    monitor.look({0, 1})
    assert not _found(monitor)
    monitor.hear(1, _state(made, 3, 1, 1))
    monitor.look({0, 1})
    (breach,) = _found(monitor)
    assert (breach.claim, breach.robots, breach.round) == ("invariant Own", (0,), 3)
    monitor.look({0, 1})
    assert _found(monitor) == (breach,)


def test_what_lasts_is_told_once_and_judged_in_each_of_its_rounds() -> None:
    monitor, made = _monitor(own=5)
    told: list[LastingState] = []
    for round_, k in enumerate([1, 1, 1, 1, 6, 6, 6, 1]):
        # The other one tells of the store, in each round.
        monitor.hear(1, _telling(made, round_, 1, 0))
        state = replace(_state(made, round_, 0, k), shared=None)
        if not (told and told[-1].goes_on_with(state)):
            told.append(LastingState(state))
    assert [(one.state.round, one.rounds) for one in told] == [(0, 4), (4, 3), (7, 1)]
    seen: list[int] = []
    monitor.seen = seen.append
    for one in told:
        monitor.hear(0, one.state, one.rounds)
        monitor.look({0, 1})
    (breach,) = _found(monitor)
    assert (breach.robots, breach.round, breach.times) == ((0,), 4, 3)
    assert seen == list(range(8))


def test_what_lasts_is_judged_where_the_store_is_told_first() -> None:
    monitor, made = _monitor(own=5)
    monitor.hear(0, replace(_state(made, 3, 0, 6), shared=None), 3)
    monitor.hear(1, replace(_state(made, 3, 1, 0), shared=None))
    monitor.hear(1, _telling(made, 4, 1, 0))
    monitor.hear(1, _telling(made, 5, 1, 0))
    monitor.look({0, 1})
    (breach,) = _found(monitor)
    assert (breach.robots, breach.round, breach.times) == ((0,), 4, 2)


def test_what_tells_of_the_store_stands_for_one_round_of_it() -> None:
    _, made = _monitor(own=5)
    first = replace(_state(made, 3, 0, 1), shared=(7,))
    lasting = LastingState(first)
    assert not lasting.goes_on_with(replace(first, round=5, shared=None))
    assert not lasting.goes_on_with(replace(first, round=4))
    assert not lasting.goes_on_with(replace(first, round=4, shared=None, ran=2))
    assert not lasting.goes_on_with(replace(first, round=4, shared=None, status=1))
    assert lasting.goes_on_with(replace(first, round=4, shared=None))
    assert lasting.rounds == 2


def test_a_robot_that_is_heard_again_is_judged_again() -> None:
    monitor, made = _monitor(own=5)
    monitor.hear(0, _telling(made, 3, 0, 6))
    monitor.look({0})
    (breach,) = _found(monitor)
    monitor.hear(0, _telling(made, 4, 0, 6))
    monitor.hear(1, replace(_state(made, 4, 1, 6), shared=None))
    monitor.look({0, 1})
    assert [(one.robots, one.times) for one in _found(monitor)] == [((0,), 2), ((1,), 1)]
    assert breach.times == 1


def test_nobody_is_accused_of_what_a_lost_robot_may_have() -> None:
    monitor, made = _monitor(own=5)
    monitor.hear(1, _state(made, 3, 1, 1))
    monitor.look({1})
    assert not _found(monitor)
    # Of the other robot it was judged.
    assert monitor.unknown == set()
    monitor.hear(1, _state(made, 5, 1, 7))
    monitor.look({1})
    (breach,) = _found(monitor)
    assert (breach.robots, breach.round) == ((1,), 5)


def test_a_robot_that_tells_nothing_does_not_keep_the_others_from_being_watched() -> None:
    monitor, made = _monitor(own=5)
    for round_ in range(40):
        monitor.hear(0, _state(made, round_, 0, 6))
    monitor.look({0, 1})
    assert not _found(monitor)
    monitor.hear(1, _state(made, 21, 1, 0))
    monitor.look({0, 1})
    (breach,) = _found(monitor)
    assert breach.round == 0
    assert breach.times == 12  # up to round 21, in the rounds of which the store is told


def test_breaches_of_several_robots_are_counted_once_and_of_two_starts_together() -> None:
    span = Span("a.krd", 1, 1, 1, 2)
    one, other = Breach("invariant A", span, (), 4, 3), Breach("invariant A", span, (), 2, 5)
    assert joined([one], [other]) == (Breach("invariant A", span, (), 2, 5),)
    assert continued([one], [other]) == (Breach("invariant A", span, (), 4, 8),)
