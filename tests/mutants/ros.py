"""Seeded mistakes in the drivers of vehicles of ROS."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

COMMANDS = "tests/runtime/platform/ros/test_commands.py"
HEARD = "tests/runtime/platform/ros/test_heard.py"
PUBLISHED = "tests/runtime/platform/ros/test_published.py"
CONFIGURATION = "tests/runtime/test_configuration.py"
NODE = "tests/runtime/platform/ros1/test_node.py"

_ROS = "runtime.drivers.ros"
_ROS1 = "runtime.drivers.ros1"

#: What is heard or told otherwise than it is meant.
ROS = (
    Mutant(
        "a vehicle of ROS that is held is told nothing",
        f"{_ROS}.commands.Wheels.command",
        "self.stop()",
        "pass",
        (COMMANDS,),
    ),
    Mutant(
        "velocities of the world are told in the frame of the body",
        f"{_ROS}.commands.Wheels.command",
        "in_body(fix.attitude, velocity)[0]",
        "velocity[0]",
        (COMMANDS,),
    ),
    Mutant(
        "who is disarmed in the air is told to stay there",
        f"{_ROS}.commands.Wings.command",
        "case Disarm() if height_m > _LANDED_M:",
        "case Disarm() if height_m < 0:",
        (COMMANDS,),
    ),
    Mutant(
        "who holds goes on to its way-point",
        f"{_ROS}.commands.Targets._stay",
        "self._aim is not None and type(setpoint) is type(self._last)",
        "self._aim is not None",
        (COMMANDS,),
    ),
    Mutant(
        "way-points are said before anybody wished for one",
        f"{_ROS}.commands.Targets.command",
        "self._aim is None and isinstance(setpoint, Hold | Land | Arm | Disarm)",
        "self._aim is None and isinstance(setpoint, Hold | Land | Arm)",
        (COMMANDS,),
    ),
    Mutant(
        "quaternions of ROS are taken for koord's",
        f"{_ROS}.poses.fix_of",
        "from_xyzw(turn.x, turn.y, turn.z, turn.w)",
        "(turn.x, turn.y, turn.z, turn.w)",
        (COMMANDS,),
    ),
    Mutant(
        "velocities of odometry are taken for those of the world",
        f"{_ROS}.poses.velocity_of",
        "rotated(fix.attitude, vector_of(message.twist.twist.linear))",
        "vector_of(message.twist.twist.linear)",
        (COMMANDS,),
    ),
    Mutant(
        "poses of another frame count",
        f"{_ROS}.driver.RosDriver._hear_pose",
        "fix.frame != wanted",
        "fix.frame == wanted + wanted",
        (HEARD,),
    ),
    Mutant(
        "poses are as old as their stamps say",
        f"{_ROS}.driver.RosDriver._hear_pose",
        "self._heard, self._heard_at_s = fix, now_s",
        "self._heard, self._heard_at_s = fix, fix.stamp_s",
        (HEARD,),
    ),
    Mutant(
        "a vehicle of ROS that is silent answers",
        f"{_ROS}.driver.RosDriver._answers",
        "now_s - self._heard_at_s <= self.options.silent",
        "True",
        (HEARD,),
    ),
    Mutant(
        "what was said of a way-point is said of the next",
        f"{_ROS}.driver.RosDriver.command",
        "commander.aim != before",
        "before is None",
        (HEARD,),
    ),
    Mutant(
        "who leaves lets the vehicle go on",
        f"{_ROS}.driver.RosDriver.close",
        "self._links.commander.stop()",
        "vars(self)",
        (HEARD,),
    ),
    Mutant(
        "beams that meet nothing are left out",
        f"{_ROS}.readings.scanned",
        "math.isnan(told_m) or told_m < message.range_min",
        "not message.range_min <= told_m <= message.range_max",
        (COMMANDS,),
    ),
    Mutant(
        "positions that are no numbers count",
        f"{_ROS}.poses.fix_of",
        "all(map(math.isfinite, vector_of(place)))",
        "True",
        (HEARD,),
    ),
    Mutant(
        "nobody is told that a vehicle of ROS does not listen",
        f"{_ROS}.driver.RosDriver._remarks",
        "self._links.commander.sender.is_heard",
        "self._links",
        (HEARD,),
    ),
    Mutant(
        "a master of ROS 1 that was started anew is told nothing",
        f"{_ROS1}.node.Node.look",
        "self.name not in seen.on(topic, end.role)",
        "end.made is end",
        (NODE,),
    ),
    Mutant(
        "a master of ROS 1 that is lost is not told",
        f"{_ROS1}.node.Node.trouble",
        "time.monotonic() - answered_s > _LOST_S",
        "time.monotonic() < answered_s",
        (NODE,),
    ),
    Mutant(
        "messages of ROS 1 are heard again and again",
        f"{_ROS1}.graph.RospyLatest.take",
        "self._cell.pop()",
        "self._cell[-1]",
        (NODE,),
    ),
    Mutant(
        "two robots may be moved by one topic",
        "api.undriven._confused",
        "other != pid",
        "other == address",
        (PUBLISHED,),
    ),
    Mutant(
        "who checks a configuration needs what drives",
        "api.undriven._absent",
        "drives",
        "told is not None",
        (PUBLISHED,),
    ),
    Mutant(
        "what drives may be missing where it is needed",
        "api.undriven._absent",
        "drives",
        "told is None",
        (PUBLISHED,),
    ),
    Mutant(
        "topics of published configurations are those of all robots",
        "runtime.configuration.topics.topics",
        "driver == PUBLISHED",
        "driver == name",
        (CONFIGURATION,),
    ),
    Mutant(
        "way-points of published automata ask for no answer",
        f"{_ROS}.commands.Targets._say",
        "fix.frame if self._frame is None else self._frame",
        "fix.frame",
        (HEARD,),
    ),
)
