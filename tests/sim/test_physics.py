"""The level ``mujoco``: it agrees with the others, keeps limits, nobody passes through anything."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone, Level, PlannerName
from koord.runtime.motion.flying import Reference
from koord.runtime.motion.world import Box, Disc, Obstacle, Point, Polygon, World
from koord.sim.disturbances import Disturbances, Positioning, Wind
from koord.sim.fleet import Fleet, Placed
from koord.sim.squads import DeviceModel
from koord.sim.vehicles.bicycles import Bicycles, track_m
from koord.sim.vehicles.drones import PhysicalDrones, drone_described
from koord.sim.vehicles.quadrotors import Quadrotors

mujoco = pytest.importorskip("mujoco")

from koord.sim.vehicles.physics import Arena, PhysicalWheels, model_of  # noqa: E402

CAR, DRONE = Car(), Drone()
WIDE = World((-20, -20, 0), (20, 20, 3))
CALM = np.zeros((1, 3))
HERE = np.zeros((1, 3))
ENDS = ("front", "rear")


def cars(at: list[Point], heading: list[float], world: World = WIDE) -> PhysicalWheels:
    return PhysicalWheels(Bicycles(CAR, np.array(at), np.array(heading)), Arena(world))


def orders(step: int) -> Floats:
    return np.array([[0.9 * math.cos(step / 20), 0.4 * math.sin(step / 7)]])


def flight(step: int) -> Reference:
    """Up, and then along a circle."""
    t = 0.05 * step
    rise = min(t, 1.0)
    angle = max(t - 2.0, 0.0)
    at = [math.sin(angle), 1 - math.cos(angle), rise]
    speed = [math.cos(angle) * (t > 2), math.sin(angle) * (t > 2), 1.0 * (t < 1)]
    return Reference(np.array([at]), np.array([speed]), CALM)


def test_the_model_is_made_of_what_devices_say() -> None:
    car, drone = replace(CAR, mass_kg=4.2, wheelbase_m=0.4), replace(DRONE, mass_kg=1.5)
    one, other = (
        Bicycles(car, HERE, np.zeros(1)).described("car0", (1.0, 2.0, 0.0), 0.5),
        drone_described("drone0", drone, (0.0, 0.0, 1.0)),
    )
    text = model_of(WIDE, [one, other])
    model = mujoco.MjModel.from_xml_string(text)
    assert model.body("car0").subtreemass[0] == pytest.approx(4.2)
    front, rear = (model.body(model.joint(f"car0 {end} left").bodyid[0]) for end in ENDS)
    assert front.pos[0] - rear.pos[0] == pytest.approx(0.4)
    assert model.body("drone0").mass[0] == pytest.approx(1.5)
    assert model.body("drone0").inertia == pytest.approx(drone.inertia_kgm2)
    assert len(model.actuator_ctrlrange) == 3  # an engine and two servos: rotors have none


def test_a_car_drives_as_a_bicycle_does_and_keeps_its_limits() -> None:
    one, other = cars([(0, 0, 0)], [0.4]), Bicycles(CAR, HERE, np.array([0.4]))
    model, data = one._arena._running()
    wheels = [model.joint(f"car0 front {side} steering").qposadr[0] for side in ("left", "right")]
    before = 0.0
    for k in range(120):
        one.advance(orders(k), 0.01, 5)
        other.advance(orders(k), 0.01, 5)
        # Of the two front wheels the inner one turns further than the bicycle's.
        angles = np.tan(data.qpos[wheels])
        bicycle = 2 * angles[0] * angles[1] / max(abs(angles.sum()), 1e-9)
        assert abs(bicycle) <= math.tan(CAR.steering_rad) * 1.02
        assert abs(one.speed[0]) <= CAR.speed_mps
        assert abs(one.speed[0] - before) <= CAR.accel_mps2 * 0.05 * 1.2
        before = float(one.speed[0])
    assert one.position == pytest.approx(other.position, abs=0.05)
    assert one.heading == pytest.approx(other.heading, abs=0.05)
    assert one.speed == pytest.approx(other.speed, abs=0.1)


def test_the_inner_wheel_turns_further() -> None:
    """Ackermann: both front wheels stand across lines to one point on the rear axle's."""
    one = cars([(0, 0, 0)], [0.0])
    model, data = one._arena._running()
    left, right = (
        model.joint(f"car0 front {side} steering").qposadr[0] for side in ("left", "right")
    )
    for sign in (1, -1):
        for _ in range(40):
            one.advance(np.array([[0.5, sign * 0.3]]), 0.01, 5)
        inner, outer = (left, right) if sign > 0 else (right, left)
        middle = CAR.wheelbase_m / math.tan(0.3)
        half = track_m(CAR) / 2
        wanted = [math.atan(CAR.wheelbase_m / (middle + aside)) for aside in (-half, half)]
        assert np.abs(data.qpos[[inner, outer]]) == pytest.approx(wanted, abs=0.01)


def test_a_drone_leans_into_the_wind() -> None:
    drone, wind = PhysicalDrones(DRONE, np.array([[0, 0, 1.0]]), Arena(WIDE)), 3.0
    hover = Reference(np.array([[0, 0, 1.0]]), CALM, CALM)
    for _ in range(160):
        drone.advance(hover, np.array([[wind, 0, 0]]), 0.01, 5)
    _, _, y, _ = drone.state.attitude[:, 0]
    pull = DRONE.drag_kgps * wind / (DRONE.mass_kg * 9.81)
    assert 2 * math.asin(y) == pytest.approx(-math.atan(pull), abs=0.005)


def test_no_command_makes_a_car_faster_than_it_can_be() -> None:
    one = cars([(0, 0, 0)], [0.0])
    for _ in range(60):
        one.advance(np.array([[9.0, 2.0]]), 0.01, 5)
    assert CAR.speed_mps * 0.95 < one.speed[0] < CAR.speed_mps * 1.01


@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (1.5, -1.0, 0.0)])
def test_a_drone_flies_as_that_of_the_level_full(wind: tuple[float, float, float]) -> None:
    one, other = PhysicalDrones(DRONE, HERE, Arena(WIDE)), Quadrotors(DRONE, HERE)
    tilt = 0.0
    for k in range(200):
        for drone in (one, other):
            drone.advance(flight(k), np.array([wind]), 0.01, 5)
        gap = np.abs(one.state.position - other.state.position).max()
        assert gap < 0.06
        _, x, y, _ = one.state.attitude[:, 0]
        tilt = max(tilt, math.acos(1 - 2 * (x * x + y * y)))
    assert 0.05 < tilt < DRONE.tilt_rad * 1.2
    assert abs(one.state.position[2, 0] - 1.0) < 0.02


@pytest.mark.parametrize(
    ("thrust", "roll", "rotors"),
    [(99.0, 0.0, (1, 1, 1, 1)), (0.0, 99.0, (0, 0, 1, 1)), (-1.0, 0.0, (0, 0, 0, 0))],
)
def test_no_rotor_pulls_down_or_more_than_it_can(
    monkeypatch: pytest.MonkeyPatch, thrust: float, roll: float, rotors: tuple[int, ...]
) -> None:
    """And what rotors pull comes with their lag."""
    drone = PhysicalDrones(DRONE, np.array([[0.0, 0, 1.0]]), Arena(WIDE))
    wanted = np.array([thrust]), np.array([[roll], [0], [0]]), np.zeros((3, 1))
    monkeypatch.setattr(drone, "control", lambda *_: wanted)
    drone.advance(Reference(np.array([[0, 0, 1.0]]), CALM, CALM), CALM, 0.01, 1)
    most = DRONE.thrust_ratio * DRONE.mass_kg * 9.81 / 4
    asked = drone._unmixer @ (most * np.array([rotors], dtype=np.float64).T)
    hovering = np.array([[DRONE.mass_kg * 9.81], [0], [0], [0]])
    left = math.exp(-0.01 / DRONE.rotor_lag_s)
    assert drone._lift == pytest.approx(asked + (hovering - asked) * left)


def test_forces_of_rotors_point_along_the_axis_of_each_drone() -> None:
    both = PhysicalDrones(DRONE, np.array([[0.0, 0, 1], [3, 0, 1]]), Arena(WIDE))
    model, data = both._arena._running()
    for k, (w, x, y, z) in enumerate([(0.8, 0.6, 0, 0), (0.5, -0.5, 0.5, 0.5)]):
        data.qpos[7 * k + 3 : 7 * k + 7] = w, x, y, z
    both._drag = np.zeros((3, 2))
    lift = both._lift.copy()
    both.push()
    mujoco.mj_kinematics(model, data)
    for k, name in enumerate(both.names):
        axis = data.body(name).xmat.reshape(3, 3)[:, 2]
        assert data.qfrc_applied[6 * k : 6 * k + 3] == pytest.approx(lift[0, k] * axis)


def test_a_drone_that_is_told_to_land_stands_on_the_ground() -> None:
    ground = World((-3, -3, 0.5), (3, 3, 3))
    drone = PhysicalDrones(DRONE, np.array([[0.0, 0, 1.5]]), Arena(ground))
    for k in range(120):
        z = max(0.4, 1.5 - 0.02 * k)
        drone.advance(Reference(np.array([[0, 0, z]]), CALM, CALM), CALM, 0.01, 5)
    assert drone.state.position[:, 0] == pytest.approx([0, 0, 0.5], abs=0.005)
    assert drone.state.attitude[0, 0] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("aside", [0.0, 0.1, 0.25])
def test_cars_do_not_pass_through_one_another(aside: float) -> None:
    both = cars([(-1, 0, 0), (1, aside, 0)], [0.0, math.pi])
    for _ in range(100):
        both.advance(np.array([[0.8, 0.0], [0.8, 0.0]]), 0.01, 5)
        middle = both.position[:, :2] + CAR.middle_m * np.column_stack(
            [np.cos(both.heading), np.sin(both.heading)]
        )
        assert np.linalg.norm(middle[0] - middle[1]) > CAR.width_m - 0.01
        assert both.position[0, 0] < both.position[1, 0]


@pytest.mark.parametrize(
    "obstacle",
    [
        Box((1.0, -1, 0), (1.5, 1, 1)),
        Disc((1.5, 0.0), 0.5),
        Polygon(((1.0, -1), (2, -1), (2, 1), (1.0, 1)), 0.0, 1.0),
        Polygon(((1.0, 1), (2, 1), (1.6, 0), (2, -1), (1.0, -1)), -1.0),
    ],
)
def test_cars_and_drones_stop_at_obstacles(obstacle: Obstacle) -> None:
    world = replace(WIDE, obstacles=(obstacle,))
    car = cars([(0, 0, 0)], [0.0], world)
    drone = PhysicalDrones(DRONE, np.array([[0.0, 0, 0.6]]), Arena(world))
    for k in range(100):
        car.advance(np.array([[0.8, 0.0]]), 0.01, 5)
        goal = np.array([[min(0.02 * k, 1.5), 0, 0.6]])
        drone.advance(Reference(goal, CALM, CALM), CALM, 0.01, 5)
    front = CAR.middle_m + CAR.length_m / 2
    assert car.position[0, 0] == pytest.approx(1.0 - front, abs=0.02)
    assert drone.state.position[0, 0] < 1.0 - DRONE.radius_m / math.sqrt(2) + 0.05


def test_walls_keep_cars_in() -> None:
    car = cars([(0, 0, 0)], [0.3], World((-1, -1, 0), (1, 1, 2)))
    for _ in range(200):
        car.advance(np.array([[1.5, 0.0]]), 0.01, 5)
        assert np.abs(car.position[0, :2]).max() < 1.0


def test_a_drone_can_land_on_a_car() -> None:
    """Vehicles of different kinds meet, too."""
    arena = Arena(WIDE)
    car = PhysicalWheels(Bicycles(CAR, np.array([[-CAR.middle_m, 0, 0]]), np.zeros(1)), arena)
    drone = PhysicalDrones(DRONE, np.array([[0, 0, 0.5]]), arena)
    for k in range(120):
        car.advance(np.zeros((1, 2)), 0.01, 5)
        z = max(-0.2, 0.5 - 0.02 * k)
        drone.advance(Reference(np.array([[0, 0, z]]), CALM, CALM), CALM, 0.01, 5)
    assert drone.state.position[2, 0] == pytest.approx(0.13, abs=0.01)


# --- fleets ---------------------------------------------------------------------------------------

ROUGH = Disturbances(Positioning(0.01, 0.01, 20.0), 0.1, Wind((0.5, 0, 0), 0.5))
LEVELS = (Level.MUJOCO, Level.FULL)
GOALS: list[Point] = [(2.3, -1.5, 0), (-2, -1.5, 1), (2.0, 2.5, 0)]


def fleet(level: Level, disturbances: Disturbances, only: int | None = None) -> Fleet:
    car = DeviceModel(CAR, PlannerName.RRT_CAR, level, disturbances=disturbances)
    drone = DeviceModel(DRONE, PlannerName.RRT_DRONE, level, disturbances=disturbances)
    robots = [
        Placed(car, (-2.5, -2.5, 0.0), 0.5),
        Placed(drone, (2.5, -2.5, 0.0)),
        Placed(car, (-2.5, 3.0, 0.0), -1.0),
    ]
    made = Fleet(World(), robots, 7, only)
    for k, goal in enumerate(GOALS):
        if only in (None, k):
            made.go_to(k, goal)
    return made


def track(made: Fleet, seconds: float) -> Floats:
    """Positions and attitudes at every tick, shape ``(ticks, n, 7)``."""
    seen: list[Floats] = []
    made.advance_to(seconds, lambda f: seen.append(np.hstack([f.positions(), f.attitudes()])))
    return np.array(seen)


def test_robots_take_the_same_ways_as_those_of_the_level_full() -> None:
    """They plan the same paths, and are never far from each other on them."""
    found = {level: track(fleet(level, Disturbances()), 12.0) for level in LEVELS}
    one, other = (found[level][..., :3] for level in LEVELS)
    for k, goal in enumerate(GOALS):
        assert np.linalg.norm(one[-1, k] - goal) < 0.1
        # Where a robot is on its way may differ by what an engine or a rotor lags behind.
        gaps = np.linalg.norm(one[:, k, None] - other[None, :, k], axis=2).min(axis=1)
        assert gaps.max() < 0.06
        assert np.linalg.norm(one[:, k] - other[:, k], axis=1).max() < 0.3


def test_equal_seeds_make_equal_runs() -> None:
    runs = [track(fleet(Level.MUJOCO, ROUGH), 2.0).tobytes() for _ in range(2)]
    assert len({hashlib.sha256(run).hexdigest() for run in runs}) == 1


def test_who_meets_nobody_moves_as_if_it_were_alone() -> None:
    """To the last bit: each process of a run simulates its own robot."""
    together = track(fleet(Level.MUJOCO, ROUGH), 2.0)
    for k in range(len(GOALS)):
        alone = track(fleet(Level.MUJOCO, ROUGH, only=k), 2.0)
        assert np.array_equal(alone[:, k], together[:, k])
