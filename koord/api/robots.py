"""Robots of a request, with their program, as a system."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Literal, TypeAlias

from msgspec import Struct

from koord.api.results import ArgumentError
from koord.syntax import core
from koord.syntax.analysis.limits import excesses
from koord.syntax.core import LEAST_DELTA_S, MOST_DELTA_S, USUAL_ROBOTS
from koord.syntax.core import MOST_ROBOTS as MOST_ROBOTS
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System, dealt


class FleetSize(Struct, frozen=True):
    """The number of robots of a request, in all or of each kind (``Car=2,Drone=1``).

    ``any_number`` stands for every number of them: ``total`` is then no more than an example.
    ``as_stated`` is what is meant where nothing is said: what the program states, or else
    ``total``.
    """

    total: int
    kinds: tuple[tuple[str, int], ...] = ()
    any_number: bool = False
    as_stated: bool = False


AS_STATED = FleetSize(USUAL_ROBOTS, as_stated=True)
ANY_NUMBER = FleetSize(2, any_number=True)

#: How robots are asked for: so many, so many of each kind, every number of them; None: as the
#: program states with ``param int numAgents``, or else 3.
Robots: TypeAlias = int | Mapping[str, int] | Literal["any"] | FleetSize | None

#: The length of a round in seconds, exactly (a float is the decimal that it is written as); None:
#: as the program states with ``param float delta``, or else 0.1.
Seconds: TypeAlias = float | Fraction | None


def fleet_of(robots: Robots) -> FleetSize:
    """Parse the number of robots. Raises ArgumentError for an invalid one."""
    match robots:
        case None:
            return AS_STATED
        case "any":
            return ANY_NUMBER
        case FleetSize():
            return robots
        case int():
            found = FleetSize(robots)
        case Mapping():
            found = FleetSize(sum(robots.values()), tuple(robots.items()))
        case _:
            raise ArgumentError("robots", f"{robots!r} is no number of robots")
    if not 1 <= found.total <= MOST_ROBOTS or any(count < 0 for _, count in found.kinds):
        most = f"there must be 1 to {MOST_ROBOTS} robots, not {found.total}"
        raise ArgumentError("robots", most)
    return found


def delta_of(seconds: Seconds) -> Fraction | None:
    """The length of a round, exactly. Raises ArgumentError for one that is out of range."""
    if seconds is None:
        return None
    delta_s = exact_number("delta_s", seconds)
    if not LEAST_DELTA_S <= delta_s <= MOST_DELTA_S:
        raise ArgumentError("delta_s", f"δ must be from 1e-9 to 1e5 seconds, not {seconds}")
    return delta_s


def exact_number(argument: str, number: float | Fraction) -> Fraction:
    """Convert a number exactly, a float by its decimal notation. Raises ArgumentError."""
    try:
        return Fraction(repr(number) if isinstance(number, float) else number)
    except ValueError:
        raise ArgumentError(argument, f"{number} is not a number") from None


def system_of(program: core.Program, fleet: FleetSize, delta_s: Fraction | None) -> System:
    """The program with its robots; δ is by default the one that it states, or the usual one.

    Raises ArgumentError for kinds it does not have, and KoordError where it is too much for so many
    robots.
    """
    delta_s = program.instance.used_delta_s if delta_s is None else delta_s
    system = _robots(program, fleet, delta_s)
    found = excesses(program, system.kinds)
    if found:
        raise KoordError(found)
    return system


def _robots(program: core.Program, fleet: FleetSize, delta_s: Fraction) -> System:
    if fleet.as_stated and program.instance.kinds:
        return System(program, program.instance.kinds, delta_s)
    if not fleet.kinds:
        least = len(program.agents) if fleet.any_number else 1
        return dealt(program, max(fleet.total, least), delta_s)
    names = [agent.name for agent in program.agents]
    kinds: list[int] = []
    for name, count in fleet.kinds:
        if name not in names:
            known = f"there are {', '.join(names)}"
            if names == [""]:
                known = "there is only one kind, which has no name"
            raise ArgumentError("robots", f"there is no agent {name} here; {known}")
        kinds += [names.index(name)] * count
    return System(program, tuple(kinds), delta_s)
