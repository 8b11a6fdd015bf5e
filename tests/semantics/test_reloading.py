"""Going on with another program between two rounds. [RELOAD]"""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT
from koord.semantics.domain import EXACT
from koord.semantics.oracle import NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs, Start
from koord.semantics.reloading import Fate, correspondence, reloaded
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import unset
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status, System, dealt
from koord.syntax.types import INT
from koord.traces.names import Names
from koord.traces.rendering import show_storage
from tests.generators.configurations import configuration
from tests.generators.strategies import systems
from tests.loading import program_of
from tests.sampling import examples
from tests.semantics.driving import Drive, drive

COUNTING = """
    local:
        int own = 0
        boolean busy = false

    allread:
        int[] seen = 0

    allwrite:
        int total = 0

    Count:
        pre: own < 9
        eff:
            own = own + 1
            seen[pid] = own
            atomic:
                total = total + 10

    Rest:
        pre: false
        eff:
            busy = true
"""


DECLARED = "int own = 0\n        boolean busy = false"


def ran() -> Drive:
    """Two robots of the counting program after one round in which robot 1 counted."""
    return drive(program_of(COUNTING)).skip(0).go(1, "Count").env()


def gone_on(text: str, of: Drive | None = None) -> Drive:
    """The run, after it has gone on with another program."""
    of = ran() if of is None else of
    system = dealt(program_of(text), of.run.system.robots)
    found = reloaded(EXACT, of.run.system, system, of.configuration, NoInputs())
    of.run.system = system
    of.run.go_back(replace(of.run.moment, configuration=found.configuration))
    return Drive(of.run, Names(system), of.last)


def unkept(text: str) -> list[tuple[str, Home, Fate]]:
    """What is not kept of the counting program."""
    plan = correspondence(dealt(program_of(COUNTING), 2), dealt(program_of(text), 2))
    return [(one.name, one.home, one.fate) for one in plan.unkept]


def edited(old: str, new: str, text: str = COUNTING) -> str:
    assert old in text
    return text.replace(old, new)


# --- what stays -----------------------------------------------------------------------------------


@given(systems(), st.randoms(use_true_random=False))
@examples(60)
def test_going_on_with_the_same_program_changes_nothing(system: System, random: Random) -> None:
    """Rule [RELOAD]."""
    before = configuration(random, system)
    assert reloaded(EXACT, system, system, before, NoInputs()).configuration == before
    assert correspondence(system, system).unkept == ()


@given(systems(), st.randoms(use_true_random=False))
@examples(40)
def test_a_renamed_variable_starts_and_all_others_stay(system: System, random: Random) -> None:
    """Another name is another variable. [RELOAD]"""
    program = system.program
    entries = [
        (home, k) for home in ("allread", "allwrite") for k in range(len(getattr(program, home)))
    ]
    if not entries:
        return
    home, slot = random.choice(entries)
    declared: tuple[core.Declaration, ...] = getattr(program, home)
    entry = declared[slot]
    other = replace(
        entry, variable=replace(entry.variable, name="renamed"), initial=core.Start.UNSET
    )
    renamed = replace(program, **{home: (*declared[:slot], other, *declared[slot + 1 :])})
    before = configuration(random, system)
    after = reloaded(
        EXACT, system, replace(system, program=renamed), before, NoInputs()
    ).configuration
    assert [r.locals for r in after.robots] == [r.locals for r in before.robots]
    assert [r.ports for r in after.robots] == [r.ports for r in before.robots]
    for name in ("allread", "allwrite"):
        pairs = zip(getattr(before.store, name), getattr(after.store, name), strict=True)
        for k, (old, new) in enumerate(pairs):
            if (name, k) == (home, slot):
                assert new == unset(EXACT, entry.variable.type, system.robots)
            else:
                assert old == new
    assert all(robot.copy == after.store for robot in after.robots)


def test_values_stay_under_other_slots_and_in_other_events() -> None:
    text = edited(
        "int own = 0\n        boolean busy = false", "boolean busy = true\n        int own = 7"
    )
    of = gone_on(edited("own + 1", "own + 100", text))
    assert (of.each("own"), of.each("busy")) == (["0", "1"], ["false", "false"])
    assert (of.shared("seen"), of.shared("total")) == ("[0, 1]", "10")
    assert of.configuration.round == 1
    of.round("Count", None)
    assert of.each("own") == ["100", "1"]


def test_who_has_stopped_still_has() -> None:
    """Rule [STOP]."""
    of = drive(program_of(edited("total = total + 10", "total = 1\n            stop")))
    of.round("Count", None)
    of = gone_on(COUNTING, of)
    assert [robot.status for robot in of.configuration.robots] == [Status.STOPPED, Status.RUNNING]


def test_what_a_robot_ran_is_the_event_of_its_name() -> None:
    """[PROP-RAN]"""
    swapped = COUNTING.replace("Count:", "Was:").replace("Rest:", "Count:")
    assert [robot.ran for robot in ran().configuration.robots] == [NO_EVENT, 0]
    assert [robot.ran for robot in gone_on(swapped).configuration.robots] == [NO_EVENT, 1]
    renamed = edited("Count:", "Add:")
    assert [robot.ran for robot in gone_on(renamed).configuration.robots] == [NO_EVENT] * 2


# --- what starts ----------------------------------------------------------------------------------


def test_new_variables_start_as_they_do_in_the_beginning() -> None:
    """Also the robots' own entries, which all see at once. [INIT] [REFRESH]"""
    text = edited("int total = 0", "int total = 0\n        int twice = 2 * numAgents")
    text = edited("boolean busy = false", "boolean busy = false\n        int more = pid + 5", text)
    text = edited("int[] seen = 0", "int[] seen = 0\n        int[] most = pid + 7", text)
    of = gone_on(edited("own = own + 1", "own = own + more + most[pid] + twice", text))
    assert of.shared("twice") == "4"
    assert of.each("more") == ["5", "6"]
    assert of.shared("most") == "[7, 8]"
    assert [of.own(robot, "most") for robot in range(2)] == ["[7, 8]"] * 2


def test_init_is_not_run_again() -> None:
    text = edited("    Count:", "    init:\n        own = 77\n        left = 5\n\n    Count:")
    of = gone_on(edited("int own = 0", "int own = 0\n        int left", text))
    assert of.each("own") == ["0", "1"]
    assert "unset" in of.each("left")[0]


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        (
            "int total = 0",
            "int total = 0\n        int more = 1",
            [("more", Home.ALLWRITE, Fate.NEW)],
        ),
        ("boolean busy = false", "int busy = 3", [("busy", Home.LOCAL, Fate.RETYPED)]),
        (
            DECLARED,
            "int own = 0",
            [("busy", Home.LOCAL, Fate.GONE)],
        ),
        (
            "        boolean busy = false\n\n    allread:",
            "\n    allread:\n        boolean[] busy = false",
            [("busy", Home.ALLREAD, Fate.MOVED)],
        ),
    ],
)
def test_what_is_not_kept_is_listed(
    old: str, new: str, found: list[tuple[str, Home, Fate]]
) -> None:
    text = edited(old, new)
    text = edited("busy = true", "own = 1", text)
    assert unkept(text) == found


def test_what_starts_may_be_open() -> None:
    """What an assumption is about starts with any value, which is recorded. [RECORDING]"""
    of = ran()
    text = edited("int total = 0", "int total = 0\n        int luck") + "\n    assume: luck > 3\n"
    system = dealt(program_of(text), 2)

    def went_on(starts: tuple[Start, ...]) -> str:
        inputs = RecordedInputs(starts=starts)
        found = reloaded(EXACT, of.run.system, system, of.configuration, inputs)
        return show_storage(found.configuration.store.allwrite[1], INT)

    assert went_on((Start(Home.ALLWRITE, 1, None, 4),)) == "4"
    assert went_on((Start(Home.ALLWRITE, 1, None, 2),)) == "2"  # the run does not begin here
    with pytest.raises(IllegalStepError, match="no initial value was recorded for luck"):
        went_on(())


# --- where there is no step -----------------------------------------------------------------------


def test_a_run_goes_on_between_rounds_only() -> None:
    of = drive(program_of(COUNTING)).go(0, "Count")
    with pytest.raises(IllegalStepError, match=r"RELOAD.*between two rounds"):
        gone_on(COUNTING, of)


def test_robots_and_period_stay() -> None:
    of = ran()
    for other in (
        dealt(of.run.system.program, 3),
        replace(of.run.system, delta_s=Fraction(1, 3)),
    ):
        with pytest.raises(IllegalStepError, match="RELOAD"):
            reloaded(EXACT, of.run.system, other, of.configuration, NoInputs())


def test_kinds_of_robots_stay() -> None:
    one = "agent {}:\n    Go:\n        pre: true\n        eff:\n            stop\n"
    two = one.format("Car") + "\n" + one.format("Drone")
    before = dealt(program_of(two), 2)
    for text in (one.format("Car"), one.format("Drone") + "\n" + one.format("Car")):
        with pytest.raises(IllegalStepError, match=r"RELOAD.*Car, Drone"):
            correspondence(before, dealt(program_of(text), 2))


def test_a_start_that_faults_is_no_step() -> None:
    """Rule [FAULT]."""
    for home in ("int total = 0", "boolean busy = false"):
        with pytest.raises(IllegalStepError, match=r"RELOAD.*division by zero"):
            gone_on(edited(home, f"{home}\n        int bad = 1 / (numAgents - 2)"))


def test_claims_are_asked_at_once() -> None:
    """[PROP-INVARIANT]"""
    of = gone_on(COUNTING + "\n    invariant Small: total < 10\n    invariant Own: own < 10\n")
    program = of.run.system.program
    held = [
        holds_in(EXACT, of.run.system, of.configuration, p.condition, p.bound, NoInputs())[0]
        for p in program.properties
    ]
    assert held == [False, True]
