"""Planners, controllers and modules of a lab's own: the lab of specs/platforms, and faulty ones."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest
from msgspec import Struct

import koord
from koord.cli.main import main
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, NoOptions
from koord.runtime.drivers.setpoints import Drive, Sensed
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.bodies import VEHICLES
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.planning import Ground, Pose
from koord.runtime.motion.world import Box, Point, World
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.plugins.calls import Guarded, PlugIn, PlugInError
from koord.runtime.plugins.control import Steered
from koord.runtime.plugins.planning import CheckedPlanner
from koord.sim.driver import vehicle
from tests.runtime.platform.labs import lab as lab

HERE = "tests.runtime.platform.test_plug_ins"
WORLD = World((-3.0, -3.0, 0.0), (3.0, 3.0, 2.0), (Box((0.9, -0.3, 0.0), (1.3, 0.3, 1.0)),))
BODY = VEHICLES["DIFF"].body


# --- the lab of specs/platforms ------------------------------------------------------------------


def test_each_part_of_the_lab_is_shorter_than_fifty_lines(lab: Path) -> None:
    for name in ("car", "grid", "pursuit", "battery", "gripper", "camera"):
        lines = (lab / "mylab" / f"{name}.py").read_text(encoding="utf-8").splitlines()
        assert sum(bool(line.strip()) for line in lines) < 50, name


def test_what_is_installed_is_listed(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["drivers"]) == 0
    out = capsys.readouterr().out
    assert "driver      mylab_car " in out
    assert "planner     mylab_grid     mylab 1.0  options: cell" in out
    assert "controller  mylab_pursuit  mylab 1.0  options: ahead, turn" in out
    assert "module      mylab_battery" in out
    assert main(["drivers", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    names = [one["name"] for one in told["modules"]]
    assert names == ["mylab_battery", "mylab_camera", "mylab_gripper"]
    assert [one.name for one in koord.installed_plug_ins()["planner"]] == ["mylab_grid"]


@pytest.mark.slow
def test_a_program_uses_all_of_the_lab_in_a_simulation(lab: Path) -> None:
    """(P-OWN)"""
    ran = koord.simulate(str(lab / "fetch.krd"), str(lab / "fetch.yaml"))
    assert ran.ok, ran
    assert ran.setup.by_chance == ()
    again = koord.simulate(str(lab / "fetch.krd"), str(lab / "fetch.yaml"))
    assert again.time_s == ran.time_s
    assert again.figures == ran.figures


@pytest.mark.slow
def test_its_program_is_laid_out_and_holds(lab: Path) -> None:
    path = lab / "fetch.krd"
    assert koord.format(path) == path.read_text(encoding="utf-8")
    assert koord.verify(path, robots=1).holds


def test_what_plug_ins_serve_is_nothing_that_is_made_up(
    lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (lab / "fetch.yaml").read_text(encoding="utf-8")
    config = tmp_path / "fetch.yaml"
    config.write_text(text.replace("        Battery: mylab_battery\n", ""), encoding="utf-8")
    assert main(["deploy", str(lab / "fetch.krd"), str(config), "--all-local"]) == 2
    told = capsys.readouterr().err
    assert "does not sense Battery.charge" in told
    assert "Gripper" not in told


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("planner: mylab_grid", "planner: mylab_gridd", "there is no planner mylab_gridd"),
        ("{cell: 0.2}", "{cel: 0.2}", "`cel`"),
        ("controller: mylab_pursuit", "controller: pursuit", "there is no controller pursuit"),
        ("Battery: mylab_battery", "Battery: mylab_car", "there is no module mylab_car"),
        ("{takes: 0.4}", "{take: 0.4}", "unknown field `take`"),
        ("bot_type: DIFF", "bot_type: QUAD", "a QUAD is steered by its own autopilot"),
    ],
)
def test_plug_ins_that_there_are_not_are_named_with_their_place(
    lab: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    before: str,
    after: str,
    told: str,
) -> None:
    text = (lab / "fetch.yaml").read_text(encoding="utf-8")
    assert before in text
    config = tmp_path / "fetch.yaml"
    config.write_text(text.replace(before, after), encoding="utf-8")
    assert main(["config", "check", str(config)]) == 2
    out = capsys.readouterr().out
    assert told in out
    assert f"{config}:" in out


# --- plug-ins that do what they should not --------------------------------------------------------


class Faulty:
    """A planner, controller and module in one, with a fault."""

    OPTIONS: ClassVar[type[Struct]] = NoOptions
    SENSORS: ClassVar[tuple[str, ...]] = ("charge",)
    ACTUATORS: ClassVar[tuple[str, ...]] = ()

    answer: ClassVar[Callable[[], Any]] = lambda: None

    def __init__(self, site: object) -> None:
        self.site = site

    def plan(self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()) -> Any:
        return type(self).answer()

    def step(self, vehicle: Steered) -> Any:
        return type(self).answer()

    def read(self, sensed: Sensed, now_s: float) -> Mapping[str, Any]:
        found: Mapping[str, Any] = type(self).answer()
        return found


def raising() -> Any:
    raise ZeroDivisionError("division by zero")


@pytest.mark.parametrize(
    ("answer", "story"),
    [
        (raising, "raised ZeroDivisionError: division by zero"),
        (lambda: "north", "is no path"),
        (lambda: [(0.0, 0.0, 0.0)], "is no path"),
        (lambda: [(0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0)], "is no path"),
        (lambda: [(0.5, 0.0, 0.0), (2.0, 0.0, 0.0)], "does not begin at (0.00, 0.00, 0.00)"),
        (lambda: [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0)], "does not end at (2.00, 0.00, 0.00)"),
        (lambda: [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], "through an obstacle"),
    ],
)
def test_paths_of_planners_are_looked_at(answer: Callable[[], Any], story: str) -> None:
    """(P-OWN)"""

    class Planner(Faulty):
        pass

    Planner.answer = staticmethod(answer)
    made = CheckedPlanner("lab", Planner(None), Ground(WORLD, BODY, 0.25))
    start, goal = Pose((0.0, 0.0, 0.0)), (2.0, 0.0, 0.0)
    with pytest.raises(PlugInError) as caught:
        made.plan(start, goal, 0)
    assert story in caught.value.told
    assert caught.value.told.startswith("the planner lab ")
    made.forgives = True
    assert made.plan(start, goal, 0) is None
    assert made.trouble == caught.value.told


def test_who_blocks_is_named_and_waited_for_once() -> None:
    calls = Guarded("the planner lab", 0.05)
    with pytest.raises(PlugInError, match=r"has not answered for 0\.1 s"):
        calls.call(lambda: time.sleep(0.6))
    begun_s = time.monotonic()
    with pytest.raises(PlugInError, match="has not answered"):
        calls.call(lambda: 1)
    assert time.monotonic() - begun_s < 0.04
    end_s = time.monotonic() + 20.0
    while True:
        assert time.monotonic() < end_s
        try:
            assert calls.call(lambda: 1) == 1
            break
        except PlugInError:
            time.sleep(0.01)


def test_the_thread_of_calls_ends_with_them() -> None:
    calls = Guarded("the planner of nobody else", 20.0)
    assert calls.call(lambda: 1) == 1
    (thread,) = (one for one in threading.enumerate() if one.name == calls.what)
    del calls
    thread.join(20.0)
    assert not thread.is_alive()


class Driven:
    """A vehicle in virtual time, with a controller of a lab's own."""

    def __init__(self) -> None:
        self.now = 100.0
        settings = PilotSettings(
            BODY, VEHICLES["DIFF"].planners[-1], controller=PlugIn(f"{HERE}:Controller")
        )
        made = vehicle(Device(0, Vehicle("car", "DIFF"), WORLD, (0.0, 0.0, 0.0)))
        guarded = Setup(usual(BODY), field(WORLD, flat=True), 0.1)
        self.driven = DrivenVehicle(made, pilot(settings, WORLD), guarded, self.now)
        self.tick()
        self.driven.order(Order.ARM, self.now)
        self.tick(30)
        self.driven.order(Order.START, self.now)
        self.driven.go_to((0.0, 2.0, 0.0))

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.now += TICK_S
            self.driven.tick(self.now, 0.0)


class Controller(Faulty):
    pass


@pytest.mark.parametrize(
    ("answer", "story"),
    [
        (raising, "raised ZeroDivisionError: division by zero: mend it"),
        (lambda: None, "answered None: answer Drive(speed_mps, yaw_rate_radps)"),
        (lambda: Drive(float("nan")), "answered Drive("),
    ],
)
def test_a_robot_whose_controller_fails_stays_and_says_why(
    answer: Callable[[], Any], story: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-OWN)"""
    monkeypatch.setattr(Controller, "answer", staticmethod(lambda: Drive(0.2)))
    one = Driven()
    one.tick(20)
    assert one.driven.sensed.position_m[0] > 0.05
    monkeypatch.setattr(Controller, "answer", staticmethod(answer))
    one.tick(20)
    here = one.driven.sensed.position_m
    one.tick(20)
    assert one.driven.sensed.position_m == here
    assert one.driven.mode is Mode.RUNNING
    # On a busy machine it is told as well that the driver took long.
    (said,) = (each for each in one.driven.remarks if each.startswith("the controller"))
    assert f"the controller {HERE}:Controller {story}" in said
    monkeypatch.setattr(Controller, "answer", staticmethod(lambda: Drive(0.2)))
    one.tick(20)
    assert not any(each.startswith("the controller") for each in one.driven.remarks)
    assert one.driven.sensed.position_m != here


def test_a_robot_whose_module_fails_stays_until_it_does_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-OWN)"""
    monkeypatch.setattr(Controller, "answer", staticmethod(lambda: Drive(0.2)))
    one = Driven()
    one.tick(20)
    one.driven.pilot.troubles["module Battery"] = "the module lab, which serves Battery, raised"
    one.tick(20)
    here = one.driven.sensed.position_m
    one.tick(20)
    assert one.driven.sensed.position_m == here
    assert one.driven.remarks == ("the module lab, which serves Battery, raised",)
    one.driven.pilot.troubles.clear()
    one.tick(20)
    assert one.driven.sensed.position_m != here


class Module(Faulty):
    pass


@pytest.mark.parametrize(
    ("answer", "story"),
    [
        (raising, "raised ZeroDivisionError: division by zero"),
        (lambda: 7, "answered 7 = help: read() answers a mapping with charge"),
        (lambda: {}, "said nothing of charge"),
        (lambda: {"charge": "full"}, "said 'full' of charge"),
    ],
)
def test_a_module_that_fails_in_a_simulation_is_named_with_its_robot(
    answer: Callable[[], Any],
    story: str,
    lab: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """(P-OWN)"""
    monkeypatch.setattr(Module, "answer", staticmethod(answer))
    text = (lab / "fetch.yaml").read_text(encoding="utf-8")
    config = tmp_path / "fetch.yaml"
    config.write_text(text.replace("mylab_battery", f"'{HERE}:Module'"), encoding="utf-8")
    assert main(["sim", str(lab / "fetch.krd"), str(config), "--no-html"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert f"robot 0: the module {HERE}:Module, which serves Battery, {story}" in told
