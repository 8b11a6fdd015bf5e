"""Forms of the published middleware: what becomes of each, and what files that are none are."""

from __future__ import annotations

import pytest

from koord.runtime.configuration.checking import load
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.motion.bodies import PlannerName
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

#: As its launcher makes them for one agent.
ONE = """\
agent:
  pid: 2
  on_device: rover
  motion_automaton: MoatTestCar
device:
  bot_name: rover
  bot_type: CAR
  ip: 10.0.0.7
  port: 4002
  motion_automata: MoatTestCar
  planner: SimplePlanner
leader_pid: 1
num_agents: 3
"""

#: Before there was `num_agents`: ports of the others.
PORTS = ONE.replace("num_agents: 3\n", "").replace("  pid: 2\n", "  pid: 2\n  plist: [1, 2, 3]\n")

#: Addresses in agents, and devices in a list.
LISTED = """\
leader_pid: 3
agents:
  - {pid: 1, ip: 10.0.0.1, port: 2001, motion_automaton: MoatTestDrone}
  - {pid: 2, ip: 10.0.0.1, port: 2002, motion_automaton: MoatTestDrone}
  - {pid: 3, ip: 10.0.0.2, port: 2003, on_device: low}
devices:
  - {bot_name: low, bot_type: CAR}
  - {bot_name: high, bot_type: QUAD, motion_automata: MoatTestDrone}
positions: {1: [0, 5, 1], 3: [0, 0]}
"""

#: An old name of devices.
BOTS = "agents: [{pid: 0, on_device: a}]\nbots: {a: {bot_type: QUAD}}\n"

#: All of which the schema has to accept, too.
PUBLISHED = (ONE, PORTS, LISTED, BOTS)


def loaded(text: str) -> RunConfiguration:
    return load(Source("c.yaml", text))


def told(text: str) -> list[tuple[int, str]]:
    """What is taken otherwise than it is written: lines, and what is said."""
    return [(d.span.line, d.message) for d in loaded(text).warnings if d.code == "K949"]


def refused(text: str) -> list[tuple[str, int, str, str]]:
    """The mistakes of a text: code, line, message, cure."""
    with pytest.raises(KoordError) as error:
        loaded(text)
    return [(d.code, d.span.line, d.message, d.hint or "") for d in error.value.diagnostics]


# --- one agent ------------------------------------------------------------------------------------


def test_a_file_for_one_agent_is_a_run_of_all_of_which_the_others_are_like_it() -> None:
    made = loaded(ONE)
    assert [(robot.pid, robot.vehicle.name) for robot in made.robots] == [
        (0, "rover-0"),
        (1, "rover-1"),
        (2, "rover"),
    ]
    assert {robot.vehicle.type_name for robot in made.robots} == {"CAR"}
    assert {robot.vehicle.planner for robot in made.robots} == {PlannerName.STRAIGHT}
    assert {robot.vehicle.automata for robot in made.robots} == {("MoatTestCar",)}
    assert made.robots[2].address == ("10.0.0.7", 4002)
    assert len({robot.address for robot in made.robots}) == 3
    assert made.leader == 1
    assert told(ONE) == [(2, "this file tells of robot 2 alone: 2 more are taken like it")]


def test_ports_of_the_others_say_how_many_there_are() -> None:
    assert [robot.vehicle.name for robot in loaded(PORTS).robots] == [
        "rover-0",
        "rover-1",
        "rover",
        "rover-3",
    ]


def test_the_last_of_those_who_are_numbered_from_1_shows_that_they_are() -> None:
    made = loaded(ONE.replace("  pid: 2\n", "  pid: 3\n"))
    assert [robot.vehicle.name for robot in made.robots] == ["rover-1", "rover-2", "rover"]
    assert made.leader == 0


def test_one_agent_of_one_needs_no_word_about_others() -> None:
    alone = ONE.replace("num_agents: 3", "num_agents: 1").replace("leader_pid: 1\n", "")
    assert told(alone.replace("pid: 2", "pid: 0")) == []


@pytest.mark.parametrize(
    ("was", "now", "line", "message", "cure"),
    [
        ("num_agents: 3\n", "", 1, "how many robots", "num_agents: 3"),
        ("  pid: 2", "  pid: 4", 2, "pid 4 is not one of 3 robots", "1 to 3"),
        ("on_device: rover", "on_device: cat", 3, "no device cat", "rover"),
        ("num_agents", "num_robots", 13, "two forms", "num_agents"),
        ("leader_pid: 1", "leader_pid: 3", 12, "no robot 3", ""),
    ],
)
def test_mistakes_of_files_for_one_agent(
    was: str, now: str, line: int, message: str, cure: str
) -> None:
    ((code, at, said, hint),) = refused(ONE.replace(was, now))
    assert (code, at) == ("K931", line)
    assert message in said
    assert cure in hint


def test_a_number_of_agents_without_an_agent_is_refused() -> None:
    ((_, line, said, hint),) = refused("num_agents: 3\n")
    assert (line, said) == (1, "there is no `agent` in this file")
    assert "`agent`, `device` and `num_agents`" in hint


# --- several agents -------------------------------------------------------------------------------


def test_robots_are_numbered_from_0_whatever_the_lowest_pid_is() -> None:
    made = loaded(LISTED)
    assert [robot.pid for robot in made.robots] == [0, 1, 2]
    assert made.leader == 2
    assert [robot.position for robot in made.robots] == [(0.0, 5.0, 1.0), None, (0.0, 0.0, 0.0)]
    assert (3, "pids begin at 1 here, and robots are numbered from 0: pid 1 is robot 0") in told(
        LISTED
    )
    ((_, line, said, _),) = refused(LISTED.replace("leader_pid: 3", "leader_pid: 0"))
    assert (line, said) == (1, "there is no robot 0")
    ((_, line, said, _),) = refused(LISTED.replace("{1: [0", "{4: [0"))
    assert (line, said) == (9, "there is no robot 4")


def test_agents_that_name_no_device_get_those_of_a_list_in_order() -> None:
    made = loaded(LISTED)
    assert [robot.vehicle.name for robot in made.robots] == ["high", "high-2", "low"]
    assert [robot.vehicle.type_name for robot in made.robots] == ["QUAD", "QUAD", "CAR"]
    assert (4, "there is no device left for robot 2: one like high is taken") in told(LISTED)


def test_an_address_of_an_agent_counts_before_that_of_its_device() -> None:
    addresses = [robot.address for robot in loaded(LISTED).robots]
    assert addresses == [("10.0.0.1", 2001), ("10.0.0.1", 2002), ("10.0.0.2", 2003)]
    ((_, line, said, _),) = refused(LISTED.replace("ip: 10.0.0.2", "ip: 10.0.0"))
    assert (line, said) == (5, "'10.0.0' is no IPv4 address")


def test_bots_are_devices() -> None:
    assert loaded(BOTS).robots[0].vehicle.type_name == "QUAD"
    ((_, line, said, _),) = refused(f"{BOTS}devices: {{a: {{}}}}\n")
    assert (line, said) == (2, "devices are given twice")
    ((_, line, said, _),) = refused(BOTS.replace("{a: {bot_type: QUAD}}", "[{bot_type: CART}]"))
    assert (line, said) == (2, "invalid enum value 'CART'")


def test_two_devices_of_one_name_are_refused() -> None:
    ((_, line, said, _),) = refused(LISTED.replace("bot_name: high", "bot_name: low"))
    assert (line, said) == (8, "two devices are called low")


@pytest.mark.parametrize("devices", ["", "devices: []\n", "devices: {}\n", "bots: []\n"])
def test_no_agents_are_no_run(devices: str) -> None:
    ((_, line, said, hint),) = refused(f"leader_pid: 0\nagents: []\n{devices}")
    assert (line, said) == (2, "there is no robot in this file: `agents` is empty")
    assert "agents: [{pid: 0}]" in hint


def test_instead_of_an_automaton_that_its_device_has_not_the_first_is_taken() -> None:
    """(P-ROS-PUBLISHED)"""
    text = (
        "agents:\n"
        "  - {pid: 0, on_device: a, motion_automaton: MoatHectorQuadrotor}\n"
        "devices:\n"
        "  a: {motion_automata: [MoatTestDrone, MoatTestCar],\n"
        "      positioning_topic: {topic: p/, type: PoseStamped}}\n"
    )
    assert told(text) == [(2, "a has no MoatHectorQuadrotor: MoatTestDrone is taken instead")]
    assert b'"motion_automaton":"MoatTestDrone"' in loaded(text).robots[0].vehicle.options
    assert told(text.replace("MoatHectorQuadrotor", "MoatTestCar")) == []


UNKNOWN = "simulated vehicles move as their type does"


@pytest.mark.parametrize(
    ("device", "line"),
    [
        ("motion_automata: [MoatTestDrone, MoatTestDrne]", 4),
        ("motion_automata: MoatTestDrne", 4),
        ("motion: {motion_automata: [MoatTestDrne]}", 4),
        ("", 2),
    ],
)
def test_automata_that_are_not_published_are_warned_of(device: str, line: int) -> None:
    """(P-ROS-PUBLISHED)"""
    text = (
        "agents:\n"
        "  - {pid: 0, on_device: a, motion_automaton: MoatTestDrne}\n"
        "devices:\n"
        f"  a: {{bot_type: QUAD, {device}{',' if device else ''}\n"
        "      positioning_topic: {topic: p/, type: PoseStamped}}\n"
    )
    assert told(text) == [(line, f"there is no motion automaton MoatTestDrne: {UNKNOWN}")]
    hints = [one.hint for one in loaded(text).warnings]
    assert hints == ["did you mean MoatTestDrone?"]


@pytest.mark.parametrize(
    ("name", "bot_type", "planner"),
    [
        ("SimplePlanner", "QUAD", PlannerName.STRAIGHT),
        ("RRT", "QUAD", PlannerName.RRT_DRONE),
        ("RRT", "CAR", PlannerName.RRT_CAR),
        ("RRT_STAR", "DIFF", PlannerName.RRT_STAR_DIFF),
        ("RRT", "IDEAL", PlannerName.RRT_DRONE),
        ("Reeds_Shepp", "CAR", PlannerName.RRT_CAR),
        ("RRT_DUB_CAR", "CAR", PlannerName.RRT_DUB_CAR),
    ],
)
def test_planners_have_their_published_names(
    name: str, bot_type: str, planner: PlannerName
) -> None:
    text = f"num_robots: 1\ndevice: {{bot_type: {bot_type}, planner: {name}}}"
    assert loaded(text).robots[0].vehicle.planner is planner


@pytest.mark.parametrize("name", ["RRT_DUB_CAR", "Reeds_Shepp"])
def test_curves_of_cars_are_for_cars(name: str) -> None:
    ((_, line, said, _),) = refused(f"num_robots: 1\ndevice: {{bot_type: QUAD, planner: {name}}}")
    assert line == 2
    assert "is no planner for a QUAD" in said


# --- what is no configuration ---------------------------------------------------------------------

SCENE = "- {bot_name: a, bot_type: QUAD, init_pos: [1, 2, 0]}\n"


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (SCENE, "this is a scene"),
        (f"world_name: w.world\ndevices:\n{SCENE}", "this is a scene"),
        (f"devices:\n{SCENE}", "this is a scene"),
        ("2021-02-03T04:05:06 :\n- {name: a, t: 1.5}\n", "these are results of experiments"),
        ("leader_pid: int(min=0)\nagents: list(include('a'))\n---\na: {}\n", "this is a schema"),
        ("language: python\nscript: [make]\n", "continuous integration"),
        ("on: push\njobs: {a: {steps: [{run: make}]}}\n", None),
        ("num_robots: 0\n", None),
        ("seed: 1\nscript: x\n", None),
    ],
)
def test_a_file_that_is_no_configuration_is_told_what_it_is(text: str, kind: str | None) -> None:
    found = refused(text)
    if kind is None:
        assert all(code == "K931" for code, *_ in found)
        return
    ((code, line, said, hint),) = found
    assert (code, line) == ("K951", 1)
    assert kind in said
    assert hint


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("num_robots: 3\n...\ndevice: {}\n", 2, 1),
        ("agents:\n  - pid: 0\n  ...\n", 3, 3),
        ("agents:\n  - pid: 0\n  - ...\n", 3, 5),
        ("num_robots: 1\ndevice:\n  planner: ...  # as above\n", 3, 12),
        ("num_robots: 1\nworld: {tasks: [[1, 2], ...]}\n", 2, 25),
        ("num_robots: …\n", 1, 13),
    ],
)
def test_dots_of_a_listing_are_explained(text: str, line: int, column: int) -> None:
    with pytest.raises(KoordError) as error:
        loaded(text)
    (found,) = error.value.diagnostics
    assert (found.code, found.span.line, found.span.column) == ("K930", line, column)
    assert "is not part of a configuration" in found.message
    assert "leaves out" in (found.hint or "")


def test_dots_may_end_a_document_and_stand_in_texts() -> None:
    assert loaded("num_robots: 1\n...\n# the end\n").robots
    assert loaded("num_robots: 1\nparams: {name: 'and so on ...'}\n").robots
    ((_, line, said, _),) = refused("num_robots: 0\n...\n")
    assert line == 1
    assert ">= 1" in said


def test_arrays_as_numpy_prints_them_are_told() -> None:
    ((code, line, said, _),) = refused("num_robots: 1\npositions: {0: [array([1.0]), 2]}\n")
    assert (code, line) == ("K930", 2)
    assert "NumPy" in said
