"""What a program may still change after INIT: never less than what its runs change."""

from __future__ import annotations

from random import Random

import pytest

from koord.refinement.generating.palette import GENERAL
from koord.refinement.generating.programs import system
from koord.semantics.configurations import Robot
from koord.semantics.domain import EXACT, Constant
from koord.semantics.recordings import execute
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Seq
from koord.syntax import core
from koord.syntax.analysis.footprint import Footprint, WriteExtent, footprint, statuses, stops_show
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.types import BOOL, INT, ArrayType, ListType, MapType, QueueType, RecordType
from tests.generators.profiles import FINITE
from tests.generators.runs import recording
from tests.semantics.building import (
    PID,
    STOP,
    TRUE,
    TRYSTOP,
    Build,
    E,
    I,
    array,
    bound,
    for_range,
    forall,
    lst,
    queue,
    rec,
    stopped,
    table,
    when,
)

HOLDER = RecordType("Holder", (("items", ListType(INT)), ("flag", BOOL)))
K = bound("k", 0, INT)


def written(b: Build, x: E) -> WriteExtent:
    variable = x.place.variable
    return footprint(b.program()).get((variable.home, 0, variable.slot), WriteExtent.NEVER)


def test_what_is_only_read_is_never_written() -> None:
    b = Build()
    x, y = b.allwrite("x", INT, 0), b.local("y", INT, 0)
    b.init(x.set(1), y.set(2))
    b.event("Go", x.eq(y))
    assert footprint(b.program()) == {}


def test_writes_are_found_wherever_they_stand() -> None:
    b = Build()
    homes = [b.local("a", INT, 0), b.allwrite("b", INT, 0), b.allread("c", INT, 0)]
    out = b.actuator("out", INT, 0)
    b.module()
    inner = when(TRUE, homes[1].set(1), otherwise=(b.atomic(for_range(K, 0, 2, homes[0].set(K))),))
    b.event("Go", TRUE, inner, homes[2][PID].set(0), bound=1)
    b.event("Out", TRUE, out.set(1))
    assert [written(b, x) for x in (*homes, out)] == [WriteExtent.WHOLE] * 4


def test_elements_of_a_list_and_the_list_itself() -> None:
    """[LOCATION]: whoever writes elements only leaves the length as it is."""
    b = Build()
    x = b.local("x", ListType(INT), lst(INT, 1))
    b.event("Part", TRUE, x[0].set(2))
    assert written(b, x) is WriteExtent.PARTS
    b.event("Whole", TRUE, x.append(3))
    assert written(b, x) is WriteExtent.WHOLE


@pytest.mark.parametrize("operation", ["append", "remove", "pop", "into"])
def test_list_operations_write_the_list_as_a_whole(operation: str) -> None:
    """[S-APPEND] [S-REMOVE] [S-POP]"""
    b = Build()
    x, y = b.local("x", QueueType(INT), queue(INT, 1)), b.local("y", ListType(INT), lst(INT, 1))
    effect = {
        "append": x.append(2),
        "remove": x.remove(1),
        "pop": x.pop(),
        "into": x.pop(into=y[0]),
    }[operation]
    b.event("Go", TRUE, effect)
    assert written(b, x) is WriteExtent.WHOLE
    assert written(b, y) is (WriteExtent.PARTS if operation == "into" else WriteExtent.NEVER)


def test_parts_of_records_arrays_and_maps() -> None:
    b = Build()
    holder = b.local("holder", HOLDER, rec(HOLDER, lst(INT, 1), False))
    grid = b.local("grid", ArrayType(INT, 2), array(INT, 0, 0))
    names = b.local("names", MapType(INT, INT), table(INT, INT, (0, 0)))
    deep = b.local("deep", ListType(ListType(INT)), lst(ListType(INT), lst(INT, 1)))
    b.event("Go", TRUE, holder.field("items")[0].set(2), grid[0].set(1), names[0].set(1))
    b.event("Deep", TRUE, deep[0].append(2))
    assert written(b, holder) is WriteExtent.PARTS
    # An element of an array is an atom of its own; a key may be new.
    assert written(b, grid) is WriteExtent.WHOLE
    assert written(b, names) is WriteExtent.WHOLE
    assert written(b, deep) is WriteExtent.WHOLE


def test_sensors_change_by_themselves_and_modelled_ports_by_their_model() -> None:
    """[ENV-FREE] [ENV-MODEL]"""
    b = Build()
    free, wish = b.sensor("free", INT, 0, "Free"), b.actuator("wish", INT, 0, "Free")
    kept, heat = b.sensor("kept", INT, 0, "Made"), b.sensor("heat", INT, 0, "Made")
    b.module("Free")
    b.module("Made", [heat.set(heat + 1)])
    b.event("Go", TRUE)
    assert written(b, free) is WriteExtent.WHOLE
    assert written(b, heat) is WriteExtent.WHOLE
    assert written(b, wish) is WriteExtent.NEVER
    assert written(b, kept) is WriteExtent.NEVER


def test_kinds_of_robot_have_footprints_of_their_own() -> None:
    b = Build()
    b.agent("One")
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(1))
    b.agent("Two")
    b.local("y", INT, 0)
    b.event("Go", TRUE)
    assert footprint(b.program()) == {(Home.LOCAL, 0, 0): WriteExtent.WHOLE}


# --- statuses -------------------------------------------------------------------------------------


def test_statuses_are_those_that_some_run_gives() -> None:
    """[STOP] [END-PROG]: if one kind asks, every kind may be stopped at the end of a round."""

    def possible(*effects: core.Stmt) -> list[frozenset[Status]]:
        b = Build()
        for number, effect in enumerate(effects):
            b.agent(f"Kind{number}")
            b.event("Go", TRUE, when(TRUE, effect))
        return list(statuses(b.program()))

    running, asked, ended = Status.RUNNING, Status.ASKED, Status.STOPPED
    nothing = when(TRUE)
    assert possible(nothing) == [{running}]
    assert possible(STOP, nothing) == [{running, ended}, {running}]
    assert possible(TRYSTOP, nothing) == [{running, asked, ended}, {running, ended}]
    b = Build()
    b.init(TRYSTOP)
    assert list(statuses(b.program())) == [{running, asked, ended}]


def test_asking_shows_if_a_property_looks() -> None:
    """[PROP-STOPPED]"""
    b = Build()
    b.event("Go", TRUE, when(TRUE, TRYSTOP))
    assert not stops_show(b.program())
    b.invariant("Looks", forall(I, ~stopped(I)))
    assert stops_show(b.program())
    b.kind.events.clear()
    assert not stops_show(b.program())
    b.init(TRYSTOP)
    assert stops_show(b.program())


# --- generated programs ---------------------------------------------------------------------------


def changed(before: Storage[Constant], after: Storage[Constant]) -> WriteExtent:
    """How much of a variable is another than before, at least."""
    if before == after:
        return WriteExtent.NEVER
    if isinstance(before, Cell) and isinstance(after, Cell):
        old, new = before.value, after.value
        if before.is_set and isinstance(old, Seq) and isinstance(new, Seq):
            return WriteExtent.PARTS if old.length == new.length else WriteExtent.WHOLE
    return WriteExtent.PARTS


def of_robot(robot: Robot[Constant]) -> dict[tuple[Home, int, int], Storage[Constant]]:
    found = {(Home.LOCAL, robot.kind, k): storage for k, storage in enumerate(robot.locals)}
    return found | {(Home.PORT, robot.kind, k): storage for k, storage in enumerate(robot.ports)}


def test_runs_change_no_more_than_the_footprint_says() -> None:
    changes = 0
    for seed in range(150):
        made = system(Random(seed), GENERAL if seed % 2 else FINITE)
        played = recording(Random(seed), made, rounds=3)
        if played is None:
            continue
        found: Footprint = footprint(made.program)
        first, *later = list(execute(EXACT, made, played))
        for step in later:
            if step.configuration.fault is not None:
                continue
            pairs = [
                ((home, 0, slot), *storages)
                for home in (Home.ALLREAD, Home.ALLWRITE)
                for slot, storages in enumerate(
                    zip(
                        getattr(first.configuration.store, home.value),
                        getattr(step.configuration.store, home.value),
                        strict=True,
                    )
                )
            ]
            for old, new in zip(first.configuration.robots, step.configuration.robots, strict=True):
                before, after = of_robot(old), of_robot(new)
                pairs += [(key, before[key], after[key]) for key in before]
                assert Status(int(new.status)) in statuses(made.program)[new.kind], seed
            for key, was, became in pairs:
                assert changed(was, became) <= found.get(key, WriteExtent.NEVER), (seed, key)
                changes += was != became
    assert changes > 200
