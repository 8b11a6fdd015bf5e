"""What a configuration does not say comes from the file of a site. (P-SITE) (P-FENCE-UNSAID)"""

from __future__ import annotations

from pathlib import Path

import pytest

import koord
from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.remote_files import copied
from koord.runtime.configuration.checking import load
from koord.runtime.configuration.keys import new_key, shared_key
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

#: Two robots that are driven, of which nobody says where they are.
DRIVEN = """\
agents: [{pid: 0, on_device: car}, {pid: 1, on_device: drone}]
devices:
    car: {bot_type: CAR, planner: STRAIGHT, driver: ros2, ip: 10.0.0.1}
    drone: {bot_type: QUAD, planner: STRAIGHT, driver: mavlink, ip: 10.0.0.2}
"""

SITE = """\
world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}
positions: {0: [1, 0, 0], 1: [-1, 0, 0]}
network: {key_file: robots.key}
"""

#: A program that names two places.
PROGRAM = Source(
    "go.krd",
    """\
param pos[] places = [pos(1, 0.5, 0), pos(-1, -0.5, 1.2)]

using Motion:
    actuators:
        pos target

Go:
    pre: true
    eff:
        Motion.target = places[pid]
""",
)

#: The same without a place.
NOWHERE = Source("go.krd", PROGRAM.text.partition("\n\n")[2].replace("places[pid]", "Motion.psn"))


def fitted(configuration: str, program: Source = PROGRAM, *, located: bool) -> Fitted:
    read = load(Source("run.yaml", configuration))
    return fit(FitRequest(program, read, (), {}, located=located))


def refused(error: pytest.ExceptionInfo[KoordError]) -> str:
    (found,) = error.value.diagnostics
    return f"{found.span}: {found.message}"


def test_a_site_says_what_a_configuration_leaves_open() -> None:
    both = load(Source("run.yaml", DRIVEN), Source("site.yaml", SITE))
    assert both.bounded
    assert [robot.position for robot in both.robots] == [(1, 0, 0), (-1, 0, 0)]
    assert str(both.place("positions", 1)) == "site.yaml:2:30"
    assert str(both.place("agents", 1)).startswith("run.yaml:1:")
    assert [source.name for source in both.document.sources] == ["run.yaml", "site.yaml"]


def test_what_both_say_is_refused_with_both_places() -> None:
    with pytest.raises(KoordError) as error:
        load(Source("run.yaml", DRIVEN + "world: {}\n"), Source("site.yaml", SITE))
    assert refused(error) == "site.yaml:1:1: `world` is in run.yaml too, in line 5"


def test_mistakes_of_a_site_are_told_where_they_are() -> None:
    with pytest.raises(KoordError) as error:
        load(Source("run.yaml", DRIVEN), Source("site.yaml", "\nworlds: {}\n"))
    assert refused(error) == "site.yaml:2:1: there is no field `worlds` here"


def test_a_key_lies_beside_the_file_that_names_it(tmp_path: Path) -> None:
    place = tmp_path / "place"
    place.mkdir()
    key = place / "robots.key"
    key.write_text(f"{new_key()}\n", encoding="utf-8")
    key.chmod(0o600)
    (tmp_path / "run.yaml").write_text(DRIVEN, encoding="utf-8")
    (place / "site.yaml").write_text(SITE, encoding="utf-8")
    both = koord.read_configuration(str(tmp_path / "run.yaml"), str(place / "site.yaml"))
    found = shared_key(both, {})
    assert found is not None
    assert found.key.decode() == key.read_text(encoding="utf-8").strip()


def test_a_site_goes_to_robots_with_its_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-SSH-COPY)"""
    monkeypatch.setenv("KOORD_KEY", new_key())
    site = SITE.replace("network: {key_file: robots.key}", "delta: 0.2")
    both = load(Source("run.yaml", DRIVEN), Source("site.yaml", site))
    made = copied(FitRequest(PROGRAM, both, (), {}), both, None)
    assert made.words[-1] == "--site=site.yaml"
    assert {one.name: one.data for one in made.files}["site.yaml"] == site.encode()


def test_a_fence_that_nobody_says_has_room_for_all_places() -> None:
    found = fitted(DRIVEN, located=True)
    assert (found.scene.world.low, found.scene.world.high) == ((-3, -2.5, 0), (3, 2.5, 3))
    assert not found.configuration.bounded


def test_robots_that_are_simulated_have_to_begin_somewhere() -> None:
    """(K931)"""
    with pytest.raises(KoordError) as error:
        fitted(DRIVEN, located=False)
    assert "nor where robot 0 begins" in refused(error)


def test_robots_without_a_driver_have_to_begin_somewhere() -> None:
    with pytest.raises(KoordError) as error:
        fitted(DRIVEN.replace("driver: mavlink, ", ""), located=True)
    assert "nor where robot 1 begins" in refused(error)


def test_without_any_place_there_is_no_fence() -> None:
    with pytest.raises(KoordError) as error:
        fitted(DRIVEN, NOWHERE, located=True)
    assert "the program names no place in it" in refused(error)
