"""Drivers by name: koord's own, and those of other packages."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import ClassVar

import pytest
from msgspec import Struct

from koord.runtime.drivers import registry
from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.registry import DRIVERS, LOCALISERS, Registry, options_of

OWN = {"sim": "koord.sim.driver:SIMULATED"}


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    baud: int = 9600


class Car:
    """A lab's own driver."""

    OPTIONS: ClassVar[type[Struct]] = Options


@pytest.fixture
def others(monkeypatch: pytest.MonkeyPatch) -> list[EntryPoint]:
    """The entry points of other packages; a test adds its own."""
    found: list[EntryPoint] = []
    monkeypatch.setattr(
        registry, "entry_points", lambda group: [e for e in found if e.group == group]
    )
    lab = ModuleType("a_lab_of_tests")
    lab.Car = Car  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_lab_of_tests", lab)
    return found


def test_drivers_of_other_packages_are_found(others: list[EntryPoint]) -> None:
    others.append(EntryPoint("lab", "a_lab_of_tests:Car", DRIVERS.name))
    made = Registry(DRIVERS, OWN, "1.0")
    assert made.names == ["lab", "sim"]
    loaded: object = made.load("lab")
    assert loaded is Car
    assert {one.name: one.options for one in made.entries()} == {"lab": ("baud",), "sim": ()}


def test_localisers_of_other_packages_are_found_among_localisers(
    others: list[EntryPoint],
) -> None:
    others.append(EntryPoint("lab", "a_lab_of_tests:Car", LOCALISERS.name))
    made = Registry(LOCALISERS, {}, "1.0")
    assert made.names == ["lab"]
    assert Registry(DRIVERS, OWN, "1.0").names == ["sim"]
    with pytest.raises(DriverError, match="there is no localiser labb"):
        made.load("labb")


def test_what_cannot_be_loaded_is_told(others: list[EntryPoint]) -> None:
    others.append(EntryPoint("lab", "nowhere_at_all:Car", DRIVERS.name))
    made = Registry(DRIVERS, OWN, "1.0")
    (missing,) = [one.missing for one in made.entries() if one.name == "lab"]
    assert missing is not None
    assert "nowhere_at_all" in missing
    with pytest.raises(DriverError, match="cannot be loaded"):
        made.load("lab")
    with pytest.raises(DriverError, match="nowhere_at_all") as named:
        made.load("nowhere_at_all:Car")  # it stands beside the configuration, say
    assert named.value.hint == "install the package that has it, or say in PYTHONPATH where it is"


def test_two_drivers_of_one_name_are_told_apart_by_nobody(others: list[EntryPoint]) -> None:
    others.append(EntryPoint("sim", "a_lab_of_tests:Car", DRIVERS.name))
    with pytest.raises(DriverError, match="both have a driver sim"):
        Registry(DRIVERS, OWN, "1.0").load("sim")


def test_a_misspelt_name_gets_a_suggestion(others: list[EntryPoint]) -> None:
    with pytest.raises(DriverError) as caught:
        Registry(DRIVERS, OWN, "1.0").load("simm")
    assert caught.value.hint == "did you mean sim?"


@pytest.mark.parametrize(
    ("given", "told"),
    [(b'{"baud": "fast"}', "int"), (b'{"speed": 3}', "speed"), (b"[]", "object")],
)
def test_options_that_a_driver_does_not_know_are_refused(given: bytes, told: str) -> None:
    with pytest.raises(DriverError) as caught:
        options_of(Car, given)  # type: ignore[arg-type]
    assert told in caught.value.message
    assert caught.value.hint == "its options are: baud"


def test_options_are_read() -> None:
    assert options_of(Car, b'{"baud": 115200}') == Options(115200)  # type: ignore[arg-type]
