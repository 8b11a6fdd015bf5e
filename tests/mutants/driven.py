"""Seeded mistakes between a program and its vehicle, and in what may be made up."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ORDERS = "tests/runtime/platform/test_orders.py"
BEACONS = "tests/runtime/platform/test_beacons.py"
DRIVEN_BY = "tests/runtime/platform/test_driven.py"
FRAMES = "tests/runtime/platform/test_frames.py"
REGISTRY = "tests/runtime/platform/test_registry.py"
LAST_STOP = "tests/runtime/platform/test_last_stop.py"
WATCHDOG = "tests/runtime/platform/test_watchdog.py"
DRY_RUN = "tests/cli/test_dry_run.py"
WATCHED = "tests/runtime/platform/test_watched.py"
PLANNED = "tests/runtime/motion/test_planning.py"
WAYS = "tests/runtime/platform/test_ways.py"
ASKED = "tests/runtime/platform/test_asked_planners.py"

#: What moves otherwise than was decided, or without being driven.
DRIVEN = (
    Mutant(
        "ways of Dubins curves are shortened to ones that nobody looks at",
        "runtime.motion.rrt.CurvePlanner._grown",
        "self.forwards and not path.check()",
        "False",
        (PLANNED,),
    ),
    Mutant(
        "deployed robots do not look at what their environment has done",
        "runtime.deploy.member.Member._evolve",
        "monitor.evolved(held, self.round - 1 - self._turns)",
        "monitor.has_contracts",
        (WATCHED,),
    ),
    Mutant(
        "contracts are held against the same ports before and after",
        "runtime.deploy.watching.RobotMonitor.evolved",
        "vars(robot)[name]",
        "held[name]",
        (WATCHED,),
    ),
    Mutant(
        "a robot looks once at what all share",
        "runtime.deploy.watching.RobotMonitor.begun",
        "not any(map(is_not, values, self._kept))",
        "bool(values)",
        (WATCHED,),
    ),
    Mutant(
        "what did not hold of what all share is not told again while nobody writes",
        "runtime.deploy.watching.RobotMonitor.begun",
        "values if is_kept else []",
        "values",
        (WATCHED,),
    ),
    Mutant(
        "a robot that was lost is taken to be where it was",
        "runtime.deploy.watching.FleetMonitor._at",
        "return UnknownRobot()",
        "return self.robots[pid]",
        (WATCHED,),
    ),
    Mutant(
        "what lasts is judged in its first round alone",
        "runtime.deploy.watching.FleetMonitor.hear",
        "range(state.round, state.round + rounds)",
        "range(state.round, state.round + 1)",
        (WATCHED,),
    ),
    Mutant(
        "a robot that has moved is told to be where it was",
        "runtime.deploy.watching.RobotState.is_same",
        "is_so and self.own == other.own",
        "is_so",
        (WATCHED,),
    ),
    Mutant(
        "a claim that does not hold is told once while nothing changes",
        "runtime.deploy.watching.FleetMonitor._look",
        "states if is_held else []",
        "states",
        (WATCHED,),
    ),
    Mutant(
        "a store that was told of is that of later rounds",
        "runtime.deploy.watching.LastingState.goes_on_with",
        "state.shared is None and state.round == first.round + self.rounds",
        "state.round == first.round + self.rounds",
        (WATCHED,),
    ),
    Mutant(
        "invariants are looked at before all robots have told",
        "runtime.deploy.watching.FleetMonitor.look",
        "round_ <= known",
        "round_ >= 0",
        (WATCHED,),
    ),
    Mutant(
        "vehicles hear of turns that are thrown away",
        "runtime.deploy.member.Member._act",
        "self.robot.discard(changed)\nreturn",
        "vars(self.robot).update(self.robot._buffers[next(iter(self.robot._buffers))].state)\n"
        "self.host.acted(self.robot)\nreturn",
        (ORDERS,),
    ),
    Mutant(
        "vehicles are not told of what was decided",
        "runtime.platform.host.VehiclePlatform.acted",
        "self._world.order(robot)",
        "vars(robot)",
        (ORDERS,),
    ),
    Mutant(
        "what others said of their vehicles never grows old",
        "runtime.platform.host.VehiclePlatform._seen",
        "b.age_s + now_s - heard_at_s",
        "b.age_s",
        (BEACONS,),
    ),
    Mutant(
        "guardians are not told of other robots",
        "runtime.platform.vehicle.DrivenVehicle.tick",
        "Ticked(now_s, sensed, wish, round_age_s, holding, others, heartbeat_age_s, watchdog)",
        "Ticked(now_s, sensed, wish, round_age_s, holding, (), heartbeat_age_s, watchdog)",
        (DRIVEN_BY,),
    ),
    Mutant(
        "what motion wishes goes to the driver past the guardian",
        "runtime.platform.vehicle.DrivenVehicle._step",
        "self.driver.command(answer.setpoint, now_s)",
        "self.driver.command(getattr(event, 'wish', None) or answer.setpoint, now_s)",
        (DRIVEN_BY,),
    ),
    Mutant(
        "robots plan ways where their guardians do not let them be",
        "api.platforms.pilot_settings",
        "Room(safety.margin_m, scene.clearance.tracking_m)",
        "Room()",
        (WAYS,),
    ),
    Mutant(
        "straight ways to targets are as close to obstacles as bodies allow",
        "runtime.motion.group.Group.__init__",
        "max(body.radius_m, room.wide_m)",
        "body.radius_m",
        (WAYS,),
    ),
    Mutant(
        "trees keep from obstacles what bodies need and no more",
        "runtime.motion.rrt._keeping",
        "keeps_m <= reach_m",
        "True",
        (WAYS,),
    ),
    Mutant(
        "a curve is free where it begins",
        "runtime.motion.curves.is_free",
        "spare < 0",
        "spare < 0 and along == 0",
        (PLANNED,),
    ),
    Mutant(
        "where a car turns about is looked for at points of its path only",
        "runtime.motion.curves._pieces",
        "arc_m - ROUNDING_M",
        "-1.0",
        (PLANNED,),
    ),
    Mutant(
        "who is measured below the ground is led along there",
        "runtime.platform.pilots.FlyingPilot._law",
        "max(z, self._field.world.ground)",
        "z",
        (WAYS,),
    ),
    Mutant(
        "robots wait for their planners and do nothing else",
        "runtime.deploy.running.Runner.step",
        "entrance.member.host.wait_with(self._tick)",
        "entrance.member.host.beacon(0.0)",
        (ASKED,),
    ),
    Mutant(
        "a planner that thinks is asked again",
        "runtime.platform.pilots.Pilot.wish",
        "not self.asked.is_busy",
        "True",
        (ASKED,),
    ),
    Mutant(
        "a driver that raises once is not told to stop any more",
        "runtime.deploy.running.Runner._stop",
        "is_told = True",
        "return",
        (LAST_STOP,),
    ),
    Mutant(
        "who senses nothing is not told to stop",
        "runtime.platform.vehicle.DrivenVehicle._sensed",
        "not self.is_ending",
        "True",
        (LAST_STOP,),
    ),
    Mutant(
        "who stands is at rest, whatever it has heard",
        "runtime.platform.vehicle.DrivenVehicle.is_at_rest",
        "self.mode in _ENDED and self._guardian.at_rest and self._is_heard",
        "self.mode in _ENDED and self._guardian.at_rest",
        (LAST_STOP,),
    ),
    Mutant(
        "robots do not miss their watchdogs",
        "runtime.platform.watchdog.Watchdog.feed",
        "self._is_gone",
        "False",
        (WATCHDOG,),
    ),
    Mutant(
        "guardians are not told of watchdogs",
        "runtime.guardian.conditions._of_surroundings",
        "tick.watchdog is not None",
        "False",
        (WATCHDOG, "tests/runtime/guardian/test_conditions.py"),
    ),
    Mutant(
        "vehicles that nothing stops move",
        "runtime.platform.watchdog.watchdog_of",
        "wanted is DeadMan.NONE",
        "wanted is DeadMan.NONE or stopper is None",
        (WATCHDOG,),
    ),
    Mutant(
        "a simulated vehicle goes on when nobody speaks to it any more",
        "sim.driver.SimulatedVehicle._hear",
        "at_s - self._told_at_s > DEAD_MAN_S",
        "at_s < 0",
        (DRIVEN_BY,),
    ),
    Mutant(
        "attitudes of MAVLink are taken for those of koord but for the frame of the world",
        "runtime.drivers.frames.attitude_from_ned",
        "product(product(_NED_TO_ENU, attitude), _FLU_TO_FRD)",
        "product(_NED_TO_ENU, attitude)",
        (FRAMES,),
    ),
    Mutant(
        "one of two drivers of one name is taken",
        "runtime.drivers.registry.Registry._entry",
        "len(found) > 1",
        "len(found) > 2",
        (REGISTRY,),
    ),
    Mutant(
        "a vehicle that nothing drives is let pass",
        "api.undriven.undriven",
        "moving[fitted.kinds[robot.pid]]",
        "False",
        (DRY_RUN,),
    ),
    Mutant(
        "a model of an environment passes for one",
        "api.undriven.unserved",
        "module.environment is not None",
        "False",
        (DRY_RUN,),
    ),
)
