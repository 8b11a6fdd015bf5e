"""A vehicle is a row in the table: one is added here as ARCHITECTURE.md says, and simulated."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from msgspec import Struct
from msgspec.structs import replace

from koord.cli.main import main
from koord.runtime.configuration.checking import load as configured
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import (
    VEHICLES,
    Level,
    Look,
    Pace,
    PlannerName,
    VehicleType,
)
from koord.runtime.motion.planning import Touched
from koord.sim.fleet import Fleet
from koord.sim.scene import scene
from koord.sim.squads import STEP_S, STEPS, SquadSetup, upright
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from tests.sim.unpacking import data_of, unpacked

GLYPHS = Path(__file__).parents[2] / "koord/sim/page/glyphs.js"


class Tram(Struct, frozen=True):
    """It goes along its path at one speed, and stands at once."""

    LOOK: ClassVar[Look] = Look("tram", is_box=True)
    ON_GROUND: ClassVar[bool] = True
    IS_EXACT: ClassVar[bool] = False
    turning_m: ClassVar[float] = 0.0
    above_ground_m: ClassVar[float] = 0.0
    inner_radius_m: ClassVar[float] = 0.2
    outline_m: ClassVar[tuple[float, float, float]] = (0.8, 0.4, 0.0)
    radius_m: float = 0.45
    cruise_mps: float = 0.5

    @property
    def pace(self) -> Pace:
        return Pace(self.cruise_mps, 1e6, 1e6)

    def cruising(self, speed_mps: float) -> Tram:
        return replace(self, cruise_mps=speed_mps)


class Trams:
    """A squad of them."""

    def __init__(self, setup: SquadSetup) -> None:
        self.group, self.vehicles = setup.group, self
        self._position, self._heading = setup.start.copy(), setup.heading_rad.copy()

    def tick(self, now_s: float) -> None:
        group, routes = self.group, self.group.routes
        group.plan(self._position, self._heading, now_s)
        group.update(self._position, now_s)
        group.s = np.minimum(group.s + group.body.pace.cruise_mps * STEP_S * STEPS, routes.length)
        spot = routes.at(np.arange(group.count), group.s)
        has_route = group.automata.has_route
        self._position = np.where(has_route[:, None], spot.position, self._position)

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self.truth()

    def truth(self) -> tuple[Floats, Floats]:
        return self._position, self._heading

    def attitude(self) -> Floats:
        return upright(self._heading)

    def touched(self, number: int) -> tuple[Touched, ...]:
        return ()


def squad(setup: SquadSetup) -> Trams:
    """What the row in the table leads to."""
    return Trams(setup)


@pytest.fixture(autouse=True)
def _tram(monkeypatch: pytest.MonkeyPatch) -> None:
    row = VehicleType(Tram(), (PlannerName.STRAIGHT,), __name__, (Level.SIMPLE,))
    monkeypatch.setitem(VEHICLES, "TRAM", row)


TEXT = """
agents:
    - {pid: 0, on_device: tram, position: [-2, 0]}
    - {pid: 1, on_device: car, position: [2, 2]}
world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}
devices:
    car: {bot_type: CAR, planner: RRT_CAR}
    tram: {bot_type: TRAM, planner: STRAIGHT, speed: 0.4, simulation: {level: simple}}
"""


def test_a_row_in_the_table_is_all_that_a_simulation_asks() -> None:
    made = scene(configured(Source("trams.yaml", TEXT)), landmarks=())
    fleet = Fleet(made.world, made.robots)
    fleet.go_to(0, (2.0, 0.0, 0.0))
    fleet.go_to(1, (0.0, 2.0, 0.0))
    fleet.advance_to(4.0)
    assert fleet.positions()[0] == pytest.approx((-0.4, 0.0, 0.0), abs=0.05)
    assert not fleet.reached()[0]
    fleet.advance_to(14.0)
    assert fleet.reached().all()
    assert fleet.sensed()[0].planner is PlannerName.STRAIGHT


def test_a_page_and_other_tools_know_its_look(tmp_path: Path) -> None:
    program, configuration = tmp_path / "still.krd", tmp_path / "still.yaml"
    program.write_text(
        "local:\n    bool done = false\n\nGo:\n    pre: not done\n    eff: done = true\n"
    )
    configuration.write_text(TEXT)
    page, recording = tmp_path / "page.html", tmp_path / "run.mcap"
    words = ["sim", str(program), str(configuration), "--rounds", "2"]
    assert main([*words, "--html", str(page), "--record", str(recording)]) == 0
    tram, car = unpacked(data_of(page.read_bytes())).document["header"]["robots"]
    assert (tram["look"], tram["length"], tram["flies"]) == ("tram", 0.8, False)
    assert car["look"] == "car"
    assert recording.stat().st_size


@pytest.mark.parametrize(
    ("written", "instead", "message", "hint"),
    [
        ("STRAIGHT", "RRT_CAR", "RRT_CAR is no planner for a TRAM", "there are STRAIGHT"),
        ("level: simple", "level: full", "a TRAM has no level full", "it has simple"),
        ("bot_type: TRAM", "bot_type: TRUM", "invalid enum value", "TRAM"),
    ],
)
def test_what_it_cannot_be_is_refused(written: str, instead: str, message: str, hint: str) -> None:
    with pytest.raises(KoordError) as refused:
        configured(Source("trams.yaml", TEXT.replace(written, instead)))
    found = refused.value.diagnostics[0]
    assert message in found.message
    assert hint in str(found.hint)


def test_what_tilts_is_drawn_so() -> None:
    """A page has no other way to know whose roll and pitch it was sent."""
    drawn = dict(re.findall(r"(\w+): \{ draw: \w+(, tilts: true)? \}", GLYPHS.read_text()))
    for row in VEHICLES.values():
        look = row.body.LOOK
        assert look.tilts == bool(drawn.get(look.name)), look
