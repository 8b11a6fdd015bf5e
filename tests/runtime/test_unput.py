"""Long arrays are copied when an event reads them, and everything is as if they always were."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime import unput
from koord.runtime.buffers import Buffer
from koord.runtime.operations import at
from koord.runtime.robot import INT, Array, Layout, ListOf, PerRobot, Robot, Shared, Turn
from koord.runtime.unput import LONG

ROBOTS = LONG + 6


class Writer(Robot):
    """A robot that writes to long arrays and short ones."""

    SHARED = Layout(
        (
            Shared("mine", PerRobot(INT)),
            Shared("long", Array(INT, LONG + 3)),
            Shared("short", Array(INT, 3)),
            Shared("rows", Array(Array(INT, 2), LONG + 2)),
            Shared("items", ListOf(INT)),
        )
    )
    EXTERNALS: ClassVar = {"peek": INT}

    mine: Any
    long: Any
    short: Any
    rows: Any
    items: Any


class Peeking:
    """A host that looks at the robot that asks it."""

    def __init__(self) -> None:
        self.robot: Robot | None = None
        self.seen: list[dict[str, Any]] = []

    def ask(self, turn: Turn, robot: int, key: Any, function: str, arguments: Any) -> int:
        self.seen.append(dict(vars(self.robot)))
        return len(self.seen)

    def choose(self, turn: Turn, robot: int, key: Any, low: int, high: int) -> int:
        self.seen.append(dict(vars(self.robot)))
        return low


def _writer() -> Writer:
    robot = Writer(2, (0,) * ROBOTS, 0.1, Peeking())  # type: ignore[arg-type]
    robot.host.robot = robot  # type: ignore[attr-defined]
    lengths = {"mine": ROBOTS, "long": LONG + 3, "short": 3, "items": LONG + 9}
    held = vars(robot)
    held |= {name: tuple(range(length)) for name, length in lengths.items()}
    held["rows"] = tuple((k, -k) for k in range(LONG + 2))
    return robot


#: What an event may do: to which variable, at which index, with which value.
_STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("own"), st.just("mine"), st.just(2), st.integers(100, 199)),
        st.tuples(
            st.sampled_from(["put", "put", "read", "whole", "row"]),
            st.sampled_from(["long", "short", "items"]),
            st.sampled_from([0, 1, 2, LONG, LONG + 4, -1]),
            st.integers(200, 299),
        ),
        st.tuples(st.just("ask"), st.just(""), st.just(0), st.integers(0, 9)),
    ),
    max_size=8,
)

Step = tuple[str, str, int, int]


def _body(steps: list[Step], read: list[Any]) -> Callable[[Any], None]:
    def body(robot: Any) -> None:
        for number, (what, name, index, value) in enumerate(steps):
            match what:
                case "own":
                    robot.set(name, value, (robot.pid,))
                case "put":
                    robot.set(name, value, (index,), f"{number}:1", f"{number}:2")
                case "read":
                    read.append(at(getattr(robot, name), index, f"{number}:3"))
                case "whole":
                    robot.set(name, tuple(range(value, value + LONG + 3)))
                case "row":
                    robot.set("rows", value, (index, 1), f"{number}:4")
                case _:
                    read.append(robot.ask("peek", (number,)))
                    read.append(robot.choose((number, 0), 0, 1, f"{number}:5"))

    return body


def _ran(steps: list[Step]) -> tuple[Any, ...]:
    """All that comes of an event: what it read, what others see of it, and what its host saw."""
    robot, read = _writer(), list[Any]()
    before = dict(vars(robot))
    buffer = robot._run(Buffer(0), _body(steps, read), Turn.PROG)
    assert vars(robot) == before
    assert set(buffer.state) == set(before)
    return read, buffer.writes, buffer.fault, buffer.state, robot._attempt(buffer), robot.host.seen  # type: ignore[attr-defined]


@given(_STEPS)
def test_events_do_as_if_arrays_were_copied_at_once(steps: list[Step]) -> None:
    with mock.patch.object(unput, "LONG", 10**9):
        expected = _ran(steps)
    assert _ran(steps) == expected


def test_an_own_entry_is_written_without_copying_those_of_all() -> None:
    robot = _writer()
    seen: list[bool] = []

    def body(robot: Any) -> None:
        robot.set("mine", 7, (2,))
        seen.append("mine" in vars(robot))
        robot.set("mine", 8, (2,))
        assert robot.mine == (0, 1, 8, *range(3, ROBOTS))
        seen.append("mine" in vars(robot))
        robot.set("long", tuple(range(50)))
        robot.set("long", -1, (1,))
        robot.set("long", tuple(range(60)))
        robot.set("long", -2, (2,))
        assert robot.long == (0, 1, -2, *range(3, 60))
        robot.set("long", -3, (3,))
        robot.ask("peek", (0,))

    buffer = robot._run(Buffer(0), body, Turn.PROG)
    assert seen == [False, True]
    assert buffer.fault is None
    ((told,),) = (robot.host.seen,)  # type: ignore[attr-defined]
    assert told["long"] == (0, 1, -2, -3, *range(4, 60))


def test_what_a_robot_has_not_is_said_to_be_missing() -> None:
    robot = _writer()
    with pytest.raises(AttributeError, match="'Writer' object has no attribute 'nothing'"):
        robot.nothing  # type: ignore[attr-defined]  # noqa: B018
    bare = Writer.__new__(Writer)
    with pytest.raises(AttributeError):
        bare.mine  # noqa: B018
