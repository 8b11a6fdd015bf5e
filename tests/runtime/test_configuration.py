"""Configuration files: both published forms, and every mistake with its line."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import jsonschema
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.configuration.checking import DEFAULT_GROUP, DEFAULT_PORT, load
from koord.runtime.configuration.forms import Carrier, SafetyForm, json_schema
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.configuration.safety import LIMIT_NAMES
from koord.runtime.guardian.limits import (
    EstopAction,
    SafetyLimits,
    flaws,
    margin_flaw,
    usual,
)
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.motion.world import Box, Disc, Polygon, World
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from tests.runtime.test_published_configurations import PUBLISHED
from tests.sampling import examples

#: The listing of the paper (fig. taskapp, right), with the dots left out.
LISTING = """\
robot:
    pid: 0
    on_device: hotdec_car
    motion_automaton: MotTestCar
device:
    bot_name: hotdec_car
    bot_type: CAR
    planner: RRT_CAR
    positioning_topic:
        topic: vrpn_client_node/
        type: PoseStamped
    reached_topic:
        topic: reached
        type: String
    waypoint_topic:
        topic: waypoint
        type: String
num_robots: 3
"""

#: A published configuration of several robots, with what they share written once.
SEVERAL = """\
leader_pid: 1
mutex_handler: BaseMutexHandler
udp_bcast_ip: 127.255.255.255
udp_port: 61820
agents:
    - pid: 1
      on_device: drone
      motion_automaton: MoatHectorQuadrotor
    - pid: 0
      on_device: car
      motion_automaton: MoatTestCar
devices:
    car:
      bot_type: CAR
      ip: 127.0.1.0
      motion: &shared
        ros_node_prefix: 'waypoint_node'
        queue_size: 1
        waypoint_topic: {topic: 'waypoint', type: PoseStamped}
        reached_topic: {topic: 'reached', type: String}
        positioning_topic: {topic: '/vrpn_client_node/', type: PoseStamped}
        planner: RRT_STAR_CAR
        motion_automata: [MoatTestCar]
    drone:
      bot_type: QUAD
      ip: 127.0.1.1
      motion:
        <<: *shared
        planner: RRT_STAR_DRONE
        motion_automata: [MoatTestDrone, MoatHectorQuadrotor]
"""


def loaded(text: str) -> RunConfiguration:
    return load(Source("run.yaml", text))


def wrong(text: str) -> list[tuple[int, str, str | None]]:
    """The mistakes of a text: line, message, cure."""
    with pytest.raises(KoordError) as error:
        loaded(text)
    return [(d.span.line, d.message, d.hint) for d in error.value.diagnostics]


# --- both forms -----------------------------------------------------------------------------------


def test_the_paper_s_listing_is_three_equal_robots() -> None:
    configuration = loaded(LISTING)
    assert [robot.pid for robot in configuration.robots] == [0, 1, 2]
    (vehicle,) = {robot.vehicle for robot in configuration.robots}
    assert (vehicle.name, vehicle.type_name) == ("hotdec_car", "CAR")
    assert vehicle.planner is PlannerName.RRT_CAR
    assert [robot.address for robot in configuration.robots] == [
        ("127.0.0.1", DEFAULT_PORT + 1 + pid) for pid in range(3)
    ]
    assert configuration.talk.shared == DEFAULT_GROUP
    assert configuration.delta_s is None


def test_fields_of_the_published_middleware_that_have_no_effect_are_told() -> None:
    """Each kind of field once, where it stands first."""
    simulated = SEVERAL.replace("bot_type:", "driver: sim\n      bot_type:")
    told = [(d.span.line, d.message) for d in loaded(simulated).warnings]
    assert told == [
        (line, f"`{name}` has no effect")
        for line, name in (
            (2, "mutex_handler"),
            (18, "ros_node_prefix"),
            (19, "queue_size"),
            (20, "waypoint_topic"),
            (21, "reached_topic"),
            (22, "positioning_topic"),
        )
    ]
    assert {d.code for d in loaded(simulated).warnings} == {"K938"}
    assert [d.message for d in loaded(SEVERAL).warnings] == ["`mutex_handler` has no effect"]
    assert not loaded("num_robots: 1\nparams: {plist: 1.0}").warnings


def test_the_form_of_several_robots_names_a_device_for_each() -> None:
    configuration = loaded(SEVERAL)
    car, drone = configuration.robots
    assert (car.vehicle.name, drone.vehicle.name) == ("car", "drone")
    planners = [robot.vehicle.planner for robot in (car, drone)]
    assert planners == [PlannerName.RRT_STAR_CAR, PlannerName.RRT_STAR_DRONE]
    assert (car.address, drone.address) == (("127.0.1.0", 61820), ("127.0.1.1", 61820))
    assert configuration.talk.carrier is Carrier.BROADCAST
    assert configuration.talk.shared == "127.255.255.255"
    assert configuration.leader == 1


def test_world_positions_and_network_may_stand_in_either() -> None:
    more = """\
delta: 0.5
seed: 7
positions: {0: [1, 2], 1: [3, 4, 1]}
world:
  bounds: {low: [-3, -4], high: [3, 4, 2]}
  obstacles:
    - disc: {centre: [0, 0], radius: 0.5}
    - box: {low: [1, 1], high: [2, 2, 1]}
    - polygon: {corners: [[0, 1], [1, 1], [1, 2]], high_z: 1}
  tasks: [[1, 2], [2, 3, 1]]
network: {transport: unicast, port: 5000, key: sixteen letters ok, run: monday}
"""
    for text in (LISTING + more, SEVERAL + more):
        configuration = loaded(text)
        world = configuration.world
        assert world is not None
        assert (world.low, world.high) == ((-3.0, -4.0, 0.0), (3.0, 4.0, 2.0))
        assert [type(obstacle) for obstacle in world.obstacles] == [Disc, Box, Polygon]
        assert world.tasks == ((1.0, 2.0, 0.0), (2.0, 3.0, 1.0))
        assert configuration.robots[0].position == (1.0, 2.0, 0.0)
        assert configuration.robots[1].position == (3.0, 4.0, 1.0)
        assert configuration.talk.key == b"sixteen letters ok"
        assert (configuration.delta_s, configuration.seed) == (0.5, 7)


# --- mistakes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "message", "hint"),
    [
        ("a: [1", 1, "not YAML", None),
        ("a: !!bool b", 1, "`b` cannot be read", None),
        ("a: !!int", 1, "`` cannot be read", None),
        ("a: !!timestamp b", 1, "`b` cannot be read", None),
        ("- 1", 1, "no fields", "agents"),
        ("", 1, "no fields", "agents"),
        ("num_robots: 3\nnum_robts: 3", 2, "no field `num_robts`", "`num_robots`"),
        ("num_robots: 3\nnum_robots: 4", 2, "given twice", "line 1"),
        ("num_robots: many", 1, "expected `int`", None),
        ("num_robots: 0", 1, ">= 1", None),
        ("num_robots: 3\ndelta: -1", 2, ">= 1e-09", None),
        ("num_robots: 3\nleader_pid: 3", 2, "no robot 3", None),
        ("num_robots: 3\npositions:\n  5: [0, 0]", 3, "no robot 5", None),
        ("num_robots: 3\npositions: {0: [0]}", 2, "length >= 2", None),
        ("seed: 1", 1, "how many robots", "num_robots"),
        ("num_robots: 2\nagents: [{pid: 0}]", 2, "two forms", None),
        ("agents:\n  - pid: 0\n  - pid: 0", 3, "two robots have pid 0", None),
        ("agents:\n  - pid: 0\n  - pid: 2", 3, "pid 2 leaves a gap", "0 to 1"),
        ("agents:\n  - pid: 1\n  - pid: 4", 3, "pid 4 leaves a gap", "1 to 2"),
        ("agents:\n  - {pid: 0, on_device: cat}\ndevices:\n  car: {}", 2, "no device cat", "car"),
        ("agents: [{}]", 1, "`pid` is missing", None),
        ("num_robots: 1\ndevice: {bot_type: CARR}", 2, "enum value", "CAR, QUAD, DIFF, IDEAL"),
        ("num_robots: 1\ndevice: {planer: X}", 2, "no field `planer`", "`planner`"),
        ("num_robots: 1\ndevice:\n  motion:\n    planer: X", 4, "`planer`", "`planner`"),
        ("num_robots: 1\ndevice: {ip: 1.2.3}", 2, "no IPv4 address", None),
        ("num_robots: 2\ndevice: {ip: 10.0.0.1}", 2, "one address", "agents"),
        (
            "agents:\n - {pid: 0, on_device: a}\n - {pid: 1, on_device: b}\n"
            "devices:\n  a: {ip: 10.0.0.1}\n  b: {ip: 10.0.0.1}",
            6,
            "robots 0 and 1 both listen",
            None,
        ),
        ("num_robots: 1\nnetwork: {transport: broadcast}", 2, "where to broadcast", "udp_bcast_ip"),
        ("num_robots: 1\nnetwork: {group: 10.0.0.1}", 2, "no multicast address", "224"),
        ("num_robots: 1\nsafety: {marginn: 1}", 2, "no field `marginn` here", "`margin`"),
        ("num_robots: 1\nsafety: {margin: 0}", 2, "> 0", None),
        ("num_robots: 1\nsafety: {hold: .nan}", 2, "> 0", None),
        ("num_robots: 1\nsafety: {hold: .inf}", 2, "`hold`: inf is no limit", "specs/guardian"),
        ("num_robots: 1\nsafety: {rounds: 0.5}", 2, ">= 1", None),
        ("num_robots: 1\nsafety: {battery_low: 15}", 2, "<= 1", None),
        ("num_robots: 1\nsafety: {battery_low: 0.01}", 2, "above `battery_critical` (0.05)", None),
        ("num_robots: 1\nsafety: {battery_critical: 0.9}", 2, "`battery_low`: has to be", None),
        ("num_robots: 1\nsafety: {battery_more: 0.9}", 2, "no battery is ever so full", None),
        ("num_robots: 1\nsafety: {resume: 12}", 2, "would land (`hold`: 10)", "specs/guardian"),
        ("num_robots: 1\nsafety: {hold: 0.5}", 2, "`resume`: who holds would land", None),
        ("num_robots: 1\nsafety: {estop: fall}", 2, "enum value", "land, disarm"),
        ("num_robots: 1\nworld: {}\nsafety: {margin: 3.5}", 3, "leaves nothing of a world", None),
        ("num_robots: 1\nnetwork: {key: short}", 2, "length >= 16", None),
        (
            "num_robots: 1\nworld: {bounds: {low: [0, 0], high: [9, 9]}, tasks: [[99, 0]]}",
            2,
            "outside",
            None,
        ),
        ("num_robots: 1\nworld:\n  bounds: {low: [1, 1], high: [0, 2]}", 3, "below", None),
        ("num_robots: 1\nworld: {obstacles: [{}]}", 2, "one of", None),
        ("num_robots: 1\n1.5: x", 2, "word or a number", None),
    ],
)
def test_a_mistake_is_told_with_its_line_and_its_cure(
    text: str, line: int, message: str, hint: str | None
) -> None:
    ((at, said, cure),) = wrong(text)
    assert at == line
    assert message in said
    if hint is not None:
        assert cure is not None
        assert hint in cure


def test_what_a_device_comes_to_is_worked_out_once_for_all_its_robots() -> None:
    text = (
        "agents:\n  - {pid: 0, on_device: a}\n  - {pid: 1, on_device: b}\n"
        "  - {pid: 2, on_device: a}\n  - {pid: 3, on_device: a, motion_automaton: MoatTestCar}\n"
        "devices: {a: {motion_automata: [MoatTestCar]}, b: {}}\n"
    )
    first, other, again, flying = (place.vehicle for place in loaded(text).robots)
    assert again is first
    assert (first.name, other.name, flying.name) == ("a", "b", "a")


def test_all_mistakes_are_told_at_once() -> None:
    text = "agents:\n  - {pid: zero}\n  - {pid: 1, on: x}\ndelta: 0\nnothing: 1\n"
    assert [line for line, _, _ in wrong(text)] == [2, 3, 4, 5]


def test_aliases_of_aliases_are_refused_before_they_fill_the_memory() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    ((_, message, _),) = wrong("\n".join(lines))
    assert "too many values" in message


@pytest.mark.parametrize(
    "text",
    [
        "a: &a {b: *a}",
        "world: {obstacles: &a [*a]}",
        "world: &w {obstacles: [1, {box: *w}]}",
        "a: &a {<<: *a}",
    ],
)
def test_what_contains_itself_is_refused(text: str) -> None:
    ((line, message, _),) = wrong(text)
    assert (line, message) == (1, "this contains itself")


@pytest.mark.parametrize("brackets", ["[]", "{}"])
def test_what_is_nested_too_deep_is_refused(brackets: str) -> None:
    text = "a: " + (brackets[0] if brackets == "[]" else "{a: ") * 60 + brackets[1] * 60
    ((line, message, _),) = wrong(text)
    assert (line, message) == (1, "nested too deep")


@given(st.text(alphabet=" \n:-[]{}&*!|>'\"#%@`abpid01.~,?\t", max_size=60))
@examples(300)
def test_no_text_raises_anything_else(text: str) -> None:
    with suppress(KoordError):
        assert loaded(text).robots


# --- safety ---------------------------------------------------------------------------------------

GUARDED = """
num_robots: 1
device: {bot_type: QUAD, speed: 0.5, safety: {hold: 4, estop: disarm}}
safety: {hold: 7, margin: 0.6, battery_low: 0.4}
world: {bounds: {low: [0, 0, 0], high: [9, 9, 1]}}
"""


def test_limits_are_those_of_the_device_then_of_all_robots_then_of_the_vehicle() -> None:
    (robot,) = loaded(GUARDED).robots
    limits = robot.vehicle.safety
    assert limits.flies
    assert limits.estop is EstopAction.DISARM
    assert (limits.hold_s, limits.margin_m, limits.battery_low) == (4, 0.6, 0.4)
    assert (limits.speed_mps, limits.battery_critical) == (0.75, 0.15)


def test_each_type_of_vehicle_has_limits_that_make_sense() -> None:
    for name, row in VEHICLES.items():
        (robot,) = loaded(f"num_robots: 1\ndevice: {{bot_type: {name}}}").robots
        limits = robot.vehicle.safety
        assert limits == usual(row.body)
        assert limits.flies != row.body.ON_GROUND
        assert list(flaws(limits)) == []
        assert margin_flaw(limits.margin_m, World(), flies=limits.flies) is None


def test_a_margin_has_room_below_the_ceiling() -> None:
    narrow = GUARDED.replace("0.6", "1.1")
    ((line, message, _),) = wrong(narrow)
    assert line == 4
    assert "a margin of 1.1 m leaves nothing of a world where 1 m is most" in message
    assert loaded(narrow.replace("QUAD", "CAR")).robots


def test_limits_that_nothing_asks_for_yet_are_told_of() -> None:
    assert [(d.code, d.message) for d in loaded(GUARDED).warnings] == [
        ("K938", "`safety` has an effect on driven vehicles alone")
    ]
    assert not loaded("num_robots: 1\nmonitor: {safety: 0.4}").warnings


def test_each_limit_can_be_stated() -> None:
    names = {LIMIT_NAMES.get(name, name) for name in SafetyForm.__struct_fields__}
    assert names == {*SafetyLimits.__struct_fields__} - {"flies"}


# --- the schema -----------------------------------------------------------------------------------


def test_the_json_schema_accepts_both_forms() -> None:
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for text in (LISTING, SEVERAL, *PUBLISHED):
        values: Any = json.loads(json.dumps(yaml.safe_load(text)))
        assert list(validator.iter_errors(values)) == []
    assert list(validator.iter_errors({"num_robots": 0}))
    assert list(validator.iter_errors({"num_robot": 3}))


ROS = """\
agents: [{pid: 0, on_device: car}]
devices:
    car:
        bot_type: CAR
        planner: RRT_CAR
        DRIVER
        ros_node_prefix: hotdec_car
        motion:
            positioning_topic: {topic: /vrpn_client_node/, type: PoseStamped}
            waypoint_topic: {topic: waypoint, type: String}
            reached_topic: {topic: reached, type: String}
            queue_size: 1
world: {bounds: {low: [-3, -3, 0], high: [3, 3, 3]}}
"""


def test_topics_of_the_published_middleware_are_options_of_a_driver_that_speaks_ros() -> None:
    made = loaded(ROS.replace("DRIVER", "driver: ros2\n        options: {queue_size: 5}"))
    assert made.warnings == ()
    (robot,) = made.robots
    assert json.loads(robot.vehicle.options) == {
        "ros_node_prefix": "hotdec_car",
        "positioning_topic": {"topic": "/vrpn_client_node/", "type": "PoseStamped"},
        "waypoint_topic": {"topic": "waypoint", "type": "String"},
        "reached_topic": {"topic": "reached", "type": "String"},
        "queue_size": 5,
    }


def test_a_device_that_names_topics_and_no_driver_is_of_the_published_middleware() -> None:
    """(P-ROS-PUBLISHED)"""
    car, drone = (robot.vehicle for robot in loaded(SEVERAL).robots)
    told = [json.loads(one.options) for one in (car, drone)]
    assert (car.driver, drone.driver) == ("ros", "ros")
    assert [one["ros_node_prefix"] for one in told] == ["car/waypoint_node", "drone/waypoint_node"]
    assert [one["motion_automaton"] for one in told] == ["MoatTestCar", "MoatHectorQuadrotor"]
    assert all(one["queue_size"] == 1 for one in told)


def test_names_that_topics_cannot_have_are_made_such() -> None:
    """(P-ROS-PUBLISHED)"""
    made = loaded(
        SEVERAL.replace("car", "my-car").replace("drone:", "2nd:").replace(": drone", ": 2nd")
    )
    told = [json.loads(robot.vehicle.options)["ros_node_prefix"] for robot in made.robots]
    assert told == ["my_car/waypoint_node", "_2nd/waypoint_node"]
    assert [d.message for d in made.warnings if d.code == "K949"] == [
        "topics of my-car are those of my_car",
        "topics of 2nd are those of _2nd",
    ]


def test_devices_do_not_share_topics_by_their_names() -> None:
    found = wrong(
        SEVERAL.replace("car", "a-b").replace("drone:", "a_b:").replace(": drone", ": a_b")
    )
    assert [message for _, message, _ in found] == [
        "a-b and a_b would have the same topics, those of a_b"
    ]


def test_the_name_of_a_robot_stands_before_its_topics_once() -> None:
    (robot,) = loaded(ROS.replace("        DRIVER\n", "").replace("hotdec_car", "car/node")).robots
    assert json.loads(robot.vehicle.options)["ros_node_prefix"] == "car/node"
    (robot,) = loaded(ROS.replace("DRIVER", "driver: ros1")).robots
    assert json.loads(robot.vehicle.options)["ros_node_prefix"] == "hotdec_car"


def test_the_published_planner_of_straight_lines_is_known_by_its_name() -> None:
    (robot,) = loaded(ROS.replace("DRIVER", "").replace("RRT_CAR", "SimplePlanner")).robots
    assert robot.vehicle.planner is PlannerName.STRAIGHT


def test_without_such_a_driver_topics_have_no_effect() -> None:
    made = loaded(ROS.replace("DRIVER", "driver: sim"))
    assert {d.code for d in made.warnings} == {"K938"}
    assert len(made.warnings) == 5
    (robot,) = made.robots
    assert robot.vehicle.options == b"{}"


LOCATED = """
agents: [{pid: 0, on_device: a}, {pid: 1, on_device: b}, {pid: 2, on_device: c}]
localiser: natnet
localiser_options: {server: 10.0.0.5}
devices:
  a: {port: 9001, driver: sim, localiser_options: {body: hawk}}
  b: {port: 9002, driver: sim, localiser: gps, localiser_options: {source: gpsd}}
  c: {port: 9003, driver: sim, localiser: own}
"""


def test_a_localiser_is_that_of_all_or_of_a_device() -> None:
    """(P-LOCATE-NAME)"""
    a, b, c = (robot.vehicle for robot in loaded(LOCATED).robots)
    assert (a.localiser, b.localiser, c.localiser) == ("natnet", "gps", None)
    assert json.loads(a.localiser_options) == {"server": "10.0.0.5", "body": "hawk"}
    assert json.loads(b.localiser_options) == {"source": "gpsd"}


@pytest.mark.parametrize(
    ("was", "wrong", "told"),
    [
        ("localiser: natnet\n", "", "these are options of no localiser"),
        ("localiser: own", "localiser: own, localiser_options: {body: x}", "of no localiser"),
        ("driver: sim, localiser: gps", "localiser: gps", "nothing drives this vehicle"),
    ],
)
def test_options_that_no_localiser_has_are_refused(was: str, wrong: str, told: str) -> None:
    """(P-LOCATE-NAME)"""
    with pytest.raises(KoordError) as caught:
        loaded(LOCATED.replace(was, wrong))
    assert any(told in one.message for one in caught.value.diagnostics)
