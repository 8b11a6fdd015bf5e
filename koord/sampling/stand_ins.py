"""Stand-ins for vehicles: what the library's sensors read where no model says.

Any reading is allowed by the rules [ENV-FREE]; these are the ones that a robot would make that
follows its path in a straight line, so that a run looks like one.
"""

from __future__ import annotations

from fractions import Fraction

from koord.sampling.library import Point, along, as_value, point, points, toward
from koord.sampling.values import Sampler
from koord.semantics.configurations import Robot
from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import contents
from koord.semantics.values import Rec, Seq
from koord.syntax import core
from koord.syntax.types import BOOL, POS, ArrayType, ListType, Type

#: How far a vehicle comes in a round.
STEP_M = Fraction(1)

_MOTION = frozenset({"Motion", "MotionWithScan"})

#: Actuators that say where to go, the most telling first.
_GOALS = ("path", "route", "target")


def driven(
    sampler: Sampler, agent: core.Agent, module: core.Module, state: Robot[Constant]
) -> dict[int, Concrete]:
    """Readings of a module's sensors by slot; none for modules that nothing is known about."""
    if module.name not in _MOTION:
        return {}
    slots = {
        agent.ports[position].declaration.variable.name: agent.ports[position].declaration.variable
        for position in module.ports
    }
    psn = slots.get("psn")
    if psn is None or psn.type != POS:
        return {}
    here = _held(sampler, state, psn)
    if here is None:
        return {}
    readings = dict[int, Concrete]()
    try:
        place = point(here)
        told = _told(sampler, state, slots)
    except (ValueError, OverflowError):  # a double that is no number
        return {}
    if isinstance(told, list):
        there, end = along(told, place, STEP_M), told[-1]
    else:
        end = place if told is None else told
        there = toward(place, end, STEP_M)
    readings[psn.slot] = Rec(tuple(sampler.real(c) for c in there))
    reached = slots.get("reached")
    if reached is not None and reached.type == BOOL:
        readings[reached.slot] = there == end
    planner = slots.get("planner")
    if planner is not None:
        kept = _held(sampler, state, planner)
        if kept is not None:
            readings[planner.slot] = kept
    scan = slots.get("pscan")
    if scan is not None and scan.type == ListType(POS):
        seen = [as_value(_beside(sampler, there)) for _ in range(sampler.rng.randint(0, 3))]
        readings[scan.slot] = Seq(len(seen), tuple(_reals(sampler, value) for value in seen))
    return readings


def _told(
    sampler: Sampler, state: Robot[Constant], slots: dict[str, core.Variable]
) -> list[Point] | Point | None:
    """Where the robot was told to go: along a path, or to a target."""
    for name in _GOALS:
        variable = slots.get(name)
        if variable is None or not _is_way(variable.type):
            continue
        match _held(sampler, state, variable):
            case Seq(items=items) as path if items:
                return points(path)
            case Rec() as target:
                return point(target)
            case _:
                pass
    return None


def _is_way(type_: Type) -> bool:
    if isinstance(type_, ListType | ArrayType):
        return type_.element == POS
    return type_ == POS


def _held(sampler: Sampler, state: Robot[Constant], variable: core.Variable) -> Concrete | None:
    d = sampler.numbers.domain
    value, is_set = contents(d, state.ports[variable.slot], variable.type)
    return value if is_set else None


def _beside(sampler: Sampler, here: Point) -> Point:
    x, y, z = here
    return x + sampler.rng.randint(-3, 3), y + sampler.rng.randint(-3, 3), z


def _reals(sampler: Sampler, value: Concrete) -> Concrete:
    assert isinstance(value, Rec)
    return Rec(tuple(sampler.real(c) for c in value.fields if isinstance(c, Fraction)))
