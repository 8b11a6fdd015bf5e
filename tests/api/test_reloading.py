"""Runs that go on with edited programs: edits are data, by rounds."""

from __future__ import annotations

import os
import threading
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import koord
from koord.api.edits import FileEdits, ListedEdits
from koord.api.fitting import FitRequest, fit, fit_request
from koord.api.progress import Progress
from koord.api.sim_report import ProgramReloaded, Simulated
from koord.api.sim_run import SimulationRequest
from koord.api.simulation import simulate_fitted
from koord.sim.run_log import SHARED, RunLog
from koord.sim.running import Ending
from koord.syntax.source import Source

COUNTING = """\
local:
    int own = 0

allread:
    int[] seen = 0

allwrite:
    int total = 0

Count:
    pre: own < 1000
    eff:
        own = own + 1
        seen[pid] = own
        atomic:
            total = total + 1
"""


def asked(text: str = COUNTING, robots: int = 2) -> FitRequest:
    return fit_request(Source("counting.krd", text), None, None, robots, 1, None)


def simulated(
    *edits: tuple[int, str],
    rounds: int = 10,
    text: str = COUNTING,
    keep_going: bool = False,
    ask: bool = False,
) -> tuple[Simulated, list[ProgramReloaded]]:
    """A run of a few rounds with edits, and what was told of these."""
    request, told = asked(text), []

    def hear(progress: Progress) -> None:
        if isinstance(progress, ProgramReloaded):
            told.append(progress)

    how = SimulationRequest(
        rounds, keep_going=keep_going, edits=ListedEdits(request, edits), ask=ask
    )
    return simulate_fitted(fit(request), how, hear), told


def values(log: RunLog, name: str, robot: int = SHARED) -> list[tuple[int, Any]]:
    """The changes of a variable: rounds and values."""
    agent = log.header.agents[0]
    own = log.header.shared if robot == SHARED else agent.variables
    return [
        (done.number, change.value)
        for done in log.rounds
        for change in done.changes
        if change.robot == robot and own[change.variable].name == name
    ]


def test_values_go_on_in_the_edited_program() -> None:
    """Rule [RELOAD]."""
    edited = COUNTING.replace("total + 1", "total + 100")
    run, told = simulated((4, edited))
    assert [one.accepted for one in told] == [True]
    totals = [value for _, value in values(run.recording, "total")]
    assert totals[-1] > 500
    steps = [b - a for a, b in pairwise(totals)]
    assert steps == [1] * steps.count(1) + [100] * steps.count(100)
    assert steps.count(1)
    assert steps.count(100)
    assert run.figures.rounds == 10
    entry = run.recording.reloads[0]
    assert (entry.number, entry.text, entry.words) == (4, edited, ())


def test_what_is_not_kept_is_told() -> None:
    edited = COUNTING.replace("int own = 0", "int own = 0\n    boolean odd = false\n    int left")
    edited = edited.replace("int total = 0", "float total = 0.5").replace(
        "total + 1", "total + 1.0"
    )
    edited = edited.replace("own = own + 1", "own = own + 1\n        odd = not odd")
    run, (told,) = simulated((3, edited + "\n# the end\n"))
    assert told.notes == (
        "total is of another type and starts anew",
        "odd is new and starts",
        "left is new and is unset",
    )
    assert told.message.startswith("the program has changed; total")
    assert run.recording.reloads[0].words == told.notes
    assert values(run.recording, "odd", 0)[0][0] >= 3
    # What is in a recording stays what it was: the new `total` is another variable.
    shared = run.recording.header.shared
    assert [one.name for one in shared] == ["seen", "total", "total"]
    (reload,) = run.recording.reloads
    assert (reload.had.shared, reload.has.shared) == ((0, 1), (0, 2))


def test_values_are_dropped_when_an_edit_is_saved_again() -> None:
    text = COUNTING.replace("own", "mine")
    other = COUNTING.replace("total", "sum")
    edits = ((2, text), (3, other), (4, text), (5, text), (6, text), (7, f"{text}# x\n"))
    run, told = simulated(*edits, ask=True)
    assert [one.accepted for one in told] == [False, False, False, True, True, True]
    codes = [[d.code for d in one.diagnostics] for one in told]
    assert codes == [["K959"], ["K959"], ["K959"], [], [], []]
    assert "would drop what is in `own`" in told[0].diagnostics[0].message
    assert told[3].notes == ("mine is new and starts", "own is gone")
    assert [entry.text is not None for entry in run.recording.reloads] == [
        one.accepted for one in told
    ]


def test_nothing_is_asked_where_nothing_is_dropped() -> None:
    edited = COUNTING.replace("int own = 0", "int own = 0\n    int more = 1")
    _, (told,) = simulated((2, edited), ask=True)
    assert told.accepted


def test_a_file_that_is_saved_again_agrees(tmp_path: Path) -> None:
    path = tmp_path / "counting.krd"
    path.write_text(COUNTING, "utf-8")
    edits = FileEdits(asked(), [str(path)])
    path.write_text(COUNTING.replace("own", "mine"), "utf-8")
    edits.look()
    first = edits.take(0)
    assert first is not None
    assert not first.agreed
    os.utime(path, (1, 1))
    edits.look()
    assert edits.take(1) is None  # nobody has put it back
    edits.put_back(first)
    os.utime(path, (2, 2))
    edits.look()
    again = edits.take(2)
    assert again == replace(first, agreed=True)
    edits.put_back(first)
    path.write_text(COUNTING.replace("own", "other"), "utf-8")
    edits.look()
    newer = edits.take(3)
    assert newer is not None
    assert not newer.agreed


EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"


def test_a_drone_whose_takeoff_port_is_gone_stays_up_and_flies_on() -> None:
    source = Source("takeoff.krd", (EXAMPLES / "takeoff.krd").read_text("utf-8"))
    request = fit_request(source, EXAMPLES / "takeoff.yaml", None, None, None, None)
    without = "using Motion:\n    sensors:\n        pos psn\n\nlocal:\n    int n = 0\n"
    edits = ListedEdits(request, [(20, f"{without}\nStep:\n    eff: n = n + 1\n")])
    told: list[Progress] = []
    how = SimulationRequest(45, edits=edits)
    run = simulate_fitted(fit(request), how, told.append)
    (reload,) = (one for one in told if isinstance(one, ProgramReloaded))
    assert {"Motion.takeoff is gone", "Motion.target is gone"} <= set(reload.notes)
    before, after = run.recording.poses[20][0], run.recording.poses[-1][0]
    assert after[2] >= before[2] > 0.9
    assert after[0] > before[0] + 1


def test_a_variable_that_only_init_sets_is_unset() -> None:
    edited = COUNTING.replace("int own = 0", "int own = 0\n    int left")
    edited = edited.replace("Count:", "init:\n    left = 3\n\nCount:")
    _, (told,) = simulated((2, edited))
    assert told.notes == ("left is new and is unset (init: is not run again)",)


def test_a_program_with_mistakes_leaves_the_old_one_running() -> None:
    plain, _ = simulated()
    run, (told,) = simulated((3, COUNTING.replace("total + 1", "totla + 1")))
    assert not told.accepted
    assert "totla" in told.diagnostics[0].message
    assert run.figures.digest == plain.figures.digest
    (entry,) = run.recording.reloads
    assert entry.text is None
    assert "counting.krd" in entry.words[0]
    assert run.ending is Ending.LIMIT


def test_one_that_cannot_go_on_leaves_the_old_one_running() -> None:
    """Also where it is found when it is to go on, and hosts are those of the other one. [RELOAD]"""
    faulty = COUNTING.replace("int total = 0", "int total = 0\n    int bad = 1 / (numAgents - 2)")
    faulty = faulty.replace("total + 1", "total + bad")
    agents = "agent A:\n    Go:\n        pre: true\n        eff:\n            stop\n"
    others = agents + "\n" + agents.replace("agent A", "agent B")
    plain, _ = simulated()
    run, told = simulated((3, faulty), (5, others))
    assert [(one.accepted, one.diagnostics[-1].code) for one in told] == [(False, "K957")] * 2
    assert "division by zero" in told[0].diagnostics[0].message
    assert run.figures.digest == plain.figures.digest


GOING = """\
using Motion

local:
    int trips = 0

Go:
    pre: trips == 0 or Motion.reached
    eff:
        trips = trips + 1
        Motion.target = pos3d(trips % 2, pid, 0)
"""


def test_robots_move_on_with_the_hosts_of_the_program_that_goes_on() -> None:
    """Also where an edit without motors is refused. [ACTUATE]"""
    still = (
        "local:\n    int bad = 1 / (numAgents - 2)\n\nWait:\n    pre: bad > 0\n    eff: bad = 2\n"
    )
    request = asked(GOING)
    plain = simulate_fitted(fit(request), SimulationRequest(60))
    edits = ListedEdits(request, [(9, still)])
    refused = simulate_fitted(fit(request), SimulationRequest(60, edits=edits))
    assert refused.recording.reloads[0].text is None
    assert plain.figures.digest == refused.figures.digest
    assert plain.figures.distance_m > 2


def test_motors_may_come_and_go() -> None:
    """New ports start as they do in the beginning. [INIT]"""
    still = "local:\n    int trips = 0\n\nWait:\n    pre: trips > 0\n    eff: trips = 0\n"
    request = asked(still)
    edits = ListedEdits(request, [(9, GOING), (40, still)])
    told: list[Progress] = []
    run = simulate_fitted(fit(request), SimulationRequest(50, edits=edits), told.append)
    come, gone = [one for one in told if isinstance(one, ProgramReloaded)]
    assert "Motion.reached is new and starts" in come.notes
    assert "Motion.target is gone" in gone.notes
    assert run.figures.distance_m > 1


def test_an_edit_of_a_comment_changes_nothing_but_the_text() -> None:
    plain, _ = simulated(rounds=30)
    run, _ = simulated((7, COUNTING + "\n# that is all\n"), rounds=30)
    for name, robot in (("total", SHARED), ("seen", SHARED), ("own", 0), ("own", 1)):
        assert values(run.recording, name, robot) == values(plain.recording, name, robot)
    assert [d.deeds.tolist() for d in run.recording.rounds] == [
        d.deeds.tolist() for d in plain.recording.rounds
    ]
    assert run.figures.robots == plain.figures.robots


def test_what_is_claimed_is_asked_at_once() -> None:
    """[PROP-INVARIANT]"""
    claim = "\ninvariant Small: total < 2\n"
    run, (told,) = simulated((5, COUNTING + claim))
    assert told.accepted
    assert run.ending is Ending.VIOLATED
    (broken,) = run.broken
    assert broken.claim == "invariant Small"
    assert broken.time_s == pytest.approx(run.recording.reloads[0].time_s)
    assert run.figures.rounds == 5
    run, _ = simulated((5, COUNTING + claim), (7, COUNTING), keep_going=True)
    assert run.ending is Ending.LIMIT
    assert run.claims["invariant Small"] > 2  # also of programs that are gone


def test_events_are_recorded_under_one_number_for_a_name() -> None:
    head, _, count = COUNTING.partition("Count:")
    edited = head + "Rest:\n    pre: own >= 3\n    eff:\n        own = own\n\nCount:" + count
    run, _ = simulated((4, edited), rounds=20)
    events = run.recording.header.agents[0].events
    assert events == ("Count", "Rest")
    before = {int(deed) for done in run.recording.rounds[:5] for deed in done.deeds if deed >= 0}
    assert before == {0}
    assert int(run.recording.rounds[-2].deeds.max()) == 1


def test_a_run_that_takes_edits_goes_on_where_nothing_changes() -> None:
    done = COUNTING.replace("own < 1000", "own < 2")
    run, _ = simulated((200, COUNTING), text=done, rounds=210)
    assert run.ending is Ending.LIMIT
    assert values(run.recording, "total")[-1][0] >= 200
    request = asked(done)
    assert simulate_fitted(fit(request), SimulationRequest(210)).ending is Ending.STILL
    how = SimulationRequest(edits=ListedEdits(request, ()))
    assert how.limit_s(fit(request)) == float("inf")
    assert replace(how, rounds=3).limit_s(fit(request)) == 3 * fit(request).scene.delta_s


def test_machine_code_of_the_edited_program_does_the_same() -> None:
    """Rounds by code before the edit and behind it. [RELOAD]"""
    pytest.importorskip("llvmlite")
    edited = COUNTING.replace("total + 1", "total + 3")
    found = []
    for kernels in (True, False):
        request = asked(robots=12)
        edits = ListedEdits(request, [(400, edited)])
        how = SimulationRequest(800, edits=edits, kernels=kernels)
        found.append(simulate_fitted(fit(request), how))
    by_code, by_robots = (values(one.recording, "total")[-1] for one in found)
    assert by_code == by_robots
    assert found[0].figures.digest == found[1].figures.digest


# --- files ----------------------------------------------------------------------------------------


def test_files_are_looked_at_and_compiled_when_they_are_saved(tmp_path: Path) -> None:
    path = tmp_path / "counting.krd"
    path.write_text(COUNTING, "utf-8")
    edits = FileEdits(fit_request(str(path), None, None, 2, 1, None), [str(path)])
    edits.look()
    assert edits.take(0) is None
    path.write_text(COUNTING + "\n# more\n", "utf-8")
    edits.look()
    edit = edits.take(0)
    assert edit is not None
    assert edit.built is not None
    assert edit.sources[0].text.endswith("# more\n")
    assert edits.take(0) is None
    path.unlink()  # as between the steps of a save
    edits.look()
    assert edits.take(0) is None
    path.write_bytes(b"\xff\xfe\xff")
    edits.look()
    broken = edits.take(0)
    assert broken is not None
    assert [one.code for one in broken.diagnostics] == ["K902"]


def test_files_are_watched_as_long_as_the_run_goes_on(tmp_path: Path) -> None:
    """With ``reload`` of the public API; nobody saves anything."""
    path = tmp_path / "counting.krd"
    path.write_text(COUNTING, "utf-8")
    with pytest.raises(koord.ArgumentError, match="only runs that are looked at take edits"):
        koord.simulate(path, reload=True, rounds=3)
    before = threading.active_count()
    run = koord.simulate(path, live=True, reload=True, rounds=3, pace=10_000, robots=2)
    assert (run.ending, run.recording.reloads) == (Ending.LIMIT, [])
    assert threading.active_count() == before


def test_the_last_of_several_edits_counts() -> None:
    run, told = simulated((2, "nonsense"), (3, COUNTING + "\n# a\n"), (3, COUNTING + "\n# b\n"))
    assert [one.accepted for one in told] == [False, True]
    text = run.recording.reloads[-1].text
    assert text is not None
    assert text.endswith("# b\n")
