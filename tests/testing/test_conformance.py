"""The conformance kit: good drivers pass it, and each faulty one fails the check of its fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

import pytest

from koord.testing.conformance import CHECKS, ConformanceSuite, Finding, Subject, Verdict, conform
from koord.testing.conformance import bench as on_bench
from koord.testing.conformance.bench import Clock, VirtualClock
from koord.testing.conformance.peers import OtherSide
from koord.testing.conformance.running import NAMES, bench_of
from tests.sampling import first
from tests.testing.faulty import WIRE, Fault

#: What is deployed for.
PROGRAMS = ("program", "twin")

#: All that takes no process of its own.
QUICK = tuple(name for name in NAMES if name not in PROGRAMS)

#: What is wrong with a driver, the check that finds it, and the vehicle if it takes a certain one.
CAUGHT = (
    (Fault.SWAPPED, "frames", "DIFF"),
    (Fault.MIRRORED, "frames", "CAR"),
    (Fault.DOWN, "frames", "QUAD"),
    (Fault.XYZW, "attitude", "CAR"),
    (Fault.XYZW, "attitude", "QUAD"),
    (Fault.DEGREES, "attitude", "DIFF"),
    (Fault.TURNS_IN_DEGREES, "units", "DIFF"),
    (Fault.CENTIMETRES, "units", "DIFF"),
    (Fault.BODY_VELOCITY, "velocity", "CAR"),
    (Fault.HALF_VELOCITY, "velocity", "QUAD"),
    (Fault.TOO_FAST, "speed", "DIFF"),
    (Fault.IGNORES_HOLD, "holds", "DIFF"),
    (Fault.CREEPS, "holds", "CAR"),
    (Fault.HOLDS_LATE, "fence", "DIFF"),
    (Fault.LATE, "e-stop", "DIFF"),
    (Fault.IGNORES_DISARM, "e-stop", "CAR"),
    (Fault.WAKES, "stays", "DIFF"),
    (Fault.BLOCKS, "blocks", "DIFF"),
    (Fault.BLOCKS_ONCE, "blocks", "DIFF"),
    (Fault.OLD, "stamps", "DIFF"),
    (Fault.FUTURE, "stamps", "DIFF"),
    (Fault.BACK, "stamps", "DIFF"),
    (Fault.SELDOM, "stamps", "DIFF"),
    (Fault.FRESH, "stale", "DIFF"),
    (Fault.NEVER_BACK, "link", "DIFF"),
    (Fault.QUIET, "remarks", "DIFF"),
    (Fault.OPENS_ALONE, "nobody-there", "DIFF"),
    (Fault.RAISES_ALONE, "nobody-there", "DIFF"),
    (Fault.RAISES, "stays", "DIFF"),
    (Fault.GOES_ON, "dead-man", "CAR"),
    (Fault.GOES_ON, "dead-man", "QUAD"),
    (Fault.STAYS_UP, "lands", "QUAD"),
    (Fault.TOO_HIGH, "lands", "QUAD"),
    (Fault.TAKES_ALL, "options", "DIFF"),
    (Fault.OTHER_KIND, "capabilities", "DIFF"),
    (Fault.PERCENT, "battery", "DIFF"),
    (Fault.PORTS_RAISE, "ports", "DIFF"),
    (Fault.OPENS_ONCE, "restarts", "DIFF"),
    (Fault.HIJACKS, "second", "DIFF"),
)


def subject(fault: Fault, vehicle: str) -> Subject:
    made = "Credulous" if fault is Fault.TAKES_ALL else "Faulty"
    return Subject(
        f"tests.testing.faulty:{made}",
        b'{"fault": "%s"}' % fault.value.encode(),
        vehicle,
        (1.0, -0.5, 0.0),
        0.6 if vehicle in ("CAR", "DIFF") else 0.0,
        knows_start=True,
        arms=True,
        is_virtual=True,
    )


@pytest.fixture(autouse=True)
def wire() -> Iterator[None]:
    WIRE.__init__()  # type: ignore[misc]
    yield
    WIRE.stop()


def found(fault: Fault, vehicle: str, *only: str) -> dict[str, Finding]:
    bench = bench_of(subject(fault, vehicle), WIRE)
    return {one.check: one for one in conform(bench, only or QUICK)}


@pytest.mark.parametrize(("fault", "check", "vehicle"), first(6, CAUGHT))
def test_each_fault_is_caught_by_its_check(fault: Fault, check: str, vehicle: str) -> None:
    assert found(fault, vehicle, check)[check].verdict is Verdict.FAILED


@pytest.fixture
def _busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what calls take counts how long they wait, and not how busy the machine is."""

    def timed(call: Callable[[], object], name: str) -> tuple[object, float]:
        before_s = WIRE.waited_s
        answer = on_bench._guarded(name, call)
        return answer, WIRE.waited_s - before_s

    monkeypatch.setattr(on_bench, "_timed", timed)


@pytest.mark.usefixtures("_busy")
def test_calls_that_wait_while_nobody_is_there_are_caught() -> None:
    told = found(Fault.BLOCKS_ALONE, "DIFF", "stale", "blocks")
    assert told["blocks"].verdict is Verdict.FAILED
    assert "gone" in told["blocks"].measures[-1].seen


@pytest.mark.usefixtures("_busy")
@pytest.mark.parametrize("vehicle", first(1, ["CAR", "DIFF", "QUAD"]))
def test_nothing_is_said_of_a_driver_that_does_as_it_should(vehicle: str) -> None:
    told = found(Fault.NONE, vehicle).values()
    assert [one for one in told if one.verdict is Verdict.FAILED] == []
    skipped = {one.check for one in told if one.verdict is Verdict.SKIPPED}
    assert skipped == (set() if vehicle == "QUAD" else {"lands"})


def test_every_check_has_a_driver_that_fails_it() -> None:
    caught = {check for _, check, _ in CAUGHT}
    # That a driver opens fails with whatever opening raises; programs, where they are deployed.
    assert caught | {"pose", "opens", *PROGRAMS} == set(NAMES)
    assert found(Fault.SWAPPED, "DIFF", "pose")["pose"].verdict is Verdict.FAILED


def test_what_a_driver_raises_is_named() -> None:
    (told,) = found(Fault.RAISES, "DIFF", "stays").values()
    assert told.measures[-1].seen == "`sense` raised ZeroDivisionError: division by zero"


class TestSimulatedCar(ConformanceSuite):
    """A driver as tests of one's own."""

    LEFT_OUT: ClassVar = dict.fromkeys(PROGRAMS, "it takes as long as a deployed run")

    def subject(self) -> Subject:
        return Subject(
            "koord.sim.driver:SIMULATED", vehicle="CAR", arms=True, is_virtual=True, name="sim"
        )

    def peer(self) -> OtherSide | None:
        return None

    def clock(self) -> Clock | None:
        return VirtualClock()


def test_the_suite_has_a_test_for_each_check() -> None:
    names = {name for name in dir(ConformanceSuite) if name.startswith("test_")}
    assert names == {f"test_{check.name.replace('-', '_')}" for check in CHECKS}


def test_without_leave_nothing_moves() -> None:
    told = subject(Fault.NONE, "DIFF")
    bench = bench_of(Subject(told.target, told.options, "DIFF", is_virtual=True), WIRE)
    moves = {check.name for check in CHECKS if check.moves} - {"lands"}
    findings = {one.check: one for one in conform(bench, QUICK)}
    for name in moves.difference(PROGRAMS):
        assert findings[name].verdict is Verdict.SKIPPED, name
        assert "--arm" in findings[name].cure
