"""Host functions and sensors of the standard library, for runs on numbers. [EXTERNAL] [ENV-FREE]

A few more are known by name and type that programs commonly declare themselves: ``onPath``,
``apart``.

Each gives one answer that its summary allows (whoever asks checks it all the same). They work on
exact rationals; answers that the summary leaves open are rounded to a grid, so that numbers stay
short over thousands of rounds. They are stand-ins: the straight line for a planner, a grid of
metres for a map of the world.

Any reading is allowed by the rules [ENV-FREE]; these are the ones that a robot would make that
follows its path in a straight line, so that a run looks like one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

from koord.sampling.values import Sampler
from koord.semantics.configurations import Robot
from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import contents
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    ListType,
    MapType,
    RecordType,
    Type,
)

Point: TypeAlias = tuple[Fraction, Fraction, Fraction]
Host: TypeAlias = Callable[..., Concrete]

#: Robots on two paths that come no closer than this are clear of each other.
CLEARANCE_M = Fraction(1, 2)

#: Positions that are doubles may miss their path by so much.
_ROUNDING_M = Fraction(1, 10**6)

#: Roots that are not exact are right to so many bits; the summary asks for 40.
_ROOT_BITS = 56

#: A map of the world has cells of a metre, this many in a row, with the origin in the middle.
_CELLS = 1024

_PATH = ListType(POS)
_MAP = MapType(INT, BOOL)

#: What elaboration makes of names that the program has taken, and of overloaded ones.
_DECORATION = r"(?:library_)*(\w+?)(?:_[0-9]+)?\Z"


def host(function: core.External) -> Host | None:
    """The implementation of a library function; None for a user's function."""
    found = re.match(_DECORATION, function.name)
    if found is None:
        return None
    name, parameters = found[1], tuple(_erased(p.type) for p in function.parameters)
    return _HOSTS.get((name, parameters, _erased(function.result.type)))


def _erased(type_: Type) -> Type | str:
    """The type with tasks reduced to their name: a program may define its own task type."""
    if isinstance(type_, RecordType) and type_.fields and type_.fields[0] == ("loc", POS):
        return type_.name
    return type_


# --- roots --------------------------------------------------------------------------------------


def square_root(x: Fraction) -> Fraction:
    """The square root of a nonnegative number: exact if it is rational, else to 56 bits."""
    top, bottom = math.isqrt(x.numerator), math.isqrt(x.denominator)
    if top * top == x.numerator and bottom * bottom == x.denominator:
        return Fraction(top, bottom)
    # √x = √(x · 4ˢ) / 2ˢ with s such that the integer root has enough bits.
    size = x.numerator.bit_length() - x.denominator.bit_length()
    shift = _ROOT_BITS - size // 2
    scaled = x * Fraction(4) ** shift
    return Fraction(math.isqrt(round(scaled))) / Fraction(2) ** shift


# --- geometry -----------------------------------------------------------------------------------


def point(value: Concrete) -> Point:
    assert isinstance(value, Rec)
    x, y, z = (Fraction(c) for c in value.fields if isinstance(c, int | float | Fraction))
    return x, y, z


def points(value: Concrete) -> list[Point]:
    assert isinstance(value, Seq)
    return [point(item) for item in value.items]


def as_value(p: Point) -> Concrete:
    return Rec(p)


def listed(items: Sequence[Concrete]) -> Concrete:
    return Seq(len(items), tuple(items))


def segments_apart(a: Point, b: Point, c: Point, d: Point) -> Fraction:
    """The square of the least distance between the segments a–b and c–d, exact, in square metres.

    The least distance of two lines' points p(s), q(t) is where its gradient vanishes, clamped to
    the segments; the clamping follows Ericson, *Real-Time Collision Detection*, 5.1.9.
    """
    u, v, w = _minus(b, a), _minus(d, c), _minus(a, c)
    uu, vv, uv, uw, vw = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, w), _dot(v, w)
    if not uu or not vv:
        s = Fraction(0) if not uu else _unit(-uw / uu)
        t = Fraction(0) if not vv else _unit(vw / vv)
    else:
        determinant = uu * vv - uv * uv
        s = _unit((uv * vw - vv * uw) / determinant) if determinant else Fraction(0)
        t = (uv * s + vw) / vv
        if not 0 <= t <= 1:
            t = _unit(t)
            s = _unit((uv * t - uw) / uu)
    apart = _minus(_along(a, u, s), _along(c, v, t))
    return _dot(apart, apart)


def _unit(x: Fraction) -> Fraction:
    return min(max(x, Fraction(0)), Fraction(1))


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _along(a: Point, u: Point, s: Fraction) -> Point:
    return a[0] + u[0] * s, a[1] + u[1] * s, a[2] + u[2] * s


def _dot(a: Point, b: Point) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def paths_clear(first: Sequence[Point], second: Sequence[Point]) -> bool:
    """Return whether two paths keep the clearance everywhere; an empty path is clear of any."""
    if not first or not second:
        return True
    ones = list(pairwise(first)) or [(first[0], first[0])]
    others = list(pairwise(second)) or [(second[0], second[0])]
    least = CLEARANCE_M * CLEARANCE_M
    return all(segments_apart(a, b, c, d) > least for a, b in ones for c, d in others)


def on_path(p: Point, path: Sequence[Point], tolerance: Fraction = Fraction(0)) -> bool:
    """Return whether a point lies within the tolerance of a path, in metres."""
    pieces = list(pairwise(path)) or [(q, q) for q in path]
    return any(segments_apart(a, b, p, p) <= tolerance * tolerance for a, b in pieces)


def along(path: Sequence[Point], here: Point, step: Fraction) -> Point:
    """The point of a path ``step`` metres beyond the one nearest to ``here``.

    Points inside a piece are at a whole number of its 1024ths, so that numbers stay short.
    """
    pieces = list(pairwise(path))
    if not pieces:
        return path[-1] if path else here
    at = min(range(len(pieces)), key=lambda k: (segments_apart(*pieces[k], here, here), -k))
    while True:
        a, b = pieces[at]
        way = _minus(b, a)
        length = square_root(_dot(way, way))
        if length:
            share = _unit(_dot(_minus(here, a), way) / _dot(way, way)) + step / length
            if share < 1:
                return _along(a, way, Fraction(math.ceil(share * 1024), 1024))
            step = (share - 1) * length
        if at + 1 == len(pieces):
            return b
        at, here = at + 1, b


def toward(here: Point, there: Point, step: Fraction) -> Point:
    """The point ``step`` metres nearer to ``there``, about on the straight line.

    Coordinates are rounded to 1024ths, so that numbers do not grow from round to round.
    """
    way = _minus(there, here)
    if _dot(way, way) <= step * step:
        return there
    x, y, z = (
        min(max(Fraction(round(c * 1024), 1024), min(a, b)), max(a, b))
        for c, a, b in zip(
            _along(here, way, step / square_root(_dot(way, way))), here, there, strict=True
        )
    )
    return x, y, z


# --- the functions ------------------------------------------------------------------------------


def _sqrt(x: Concrete) -> Concrete:
    if isinstance(x, float):
        return math.sqrt(x) if x >= 0 else 0.0
    assert isinstance(x, int | Fraction)
    return square_root(Fraction(x)) if x >= 0 else Fraction(0)


def _find_path(start: Concrete, goal: Concrete, *_: Concrete) -> Concrete:
    return listed([start, goal])


def _path_to_task(task: Concrete) -> Concrete:
    assert isinstance(task, Rec)
    return listed([task.fields[0]])


def _path_from_to_task(start: Concrete, task: Concrete) -> Concrete:
    assert isinstance(task, Rec)
    return listed([start, task.fields[0]])


def _paths_clear(first: Concrete, second: Concrete) -> Concrete:
    return paths_clear(points(first), points(second))


def _on_path(p: Concrete, path: Concrete) -> Concrete:
    place, way = point(p), points(path)
    exact = isinstance(p, Rec) and not any(isinstance(c, float) for c in p.fields)
    return on_path(place, way, Fraction(0) if exact else _ROUNDING_M)


def _apart(p: Concrete, q: Concrete) -> Concrete:
    return paths_clear([point(p)], [point(q)])


def _will_not_collide(task: Concrete) -> Concrete:
    return False


def _cell(p: Point) -> int:
    x, y = (math.floor(c) + _CELLS // 2 for c in p[:2])
    return x * _CELLS + y


def _centre(cell: int) -> Point:
    x, y = divmod(cell, _CELLS)
    half = Fraction(_CELLS - 1, 2)
    return x - half, y - half, Fraction(0)


def _scan_to_map(scan: Concrete) -> Concrete:
    cells = {_cell(p): True for p in points(scan)}
    return Table(len(cells), tuple(cells.items()))


def _frontier(known: Concrete, near: Concrete) -> Concrete:
    """The middle of the unknown cell beside a known one nearest to a point, or the point."""
    assert isinstance(known, Table)
    cells = {cell for cell, _ in known.entries if isinstance(cell, int)}
    beside = sorted({c + way for c in cells for way in (-_CELLS, -1, 1, _CELLS)} - cells)
    here = point(near)
    away = [_minus(_centre(cell), here) for cell in beside]
    if not beside:
        return near
    nearest = min(range(len(beside)), key=lambda k: _dot(away[k], away[k]))
    return as_value(_centre(beside[nearest]))


def _obstacles(known: Concrete) -> Concrete:
    assert isinstance(known, Table)
    occupied = [cell for cell, there in known.entries if there and isinstance(cell, int)]
    return listed([as_value(_centre(cell)) for cell in occupied])


def _on_doubles(function: Callable[..., float]) -> Host:
    """A function of doubles on exact numbers: of the nearest double, whose answer it has."""

    def answer(*given: Concrete) -> Concrete:
        numbers = [x for x in given if isinstance(x, int | float | Fraction)]
        try:
            found = function(*map(float, numbers))
        except (OverflowError, ValueError):  # too large for a double, or infinite
            found = 0.0
        return found if any(isinstance(x, float) for x in numbers) else Fraction(found)

    return answer


def _joined_text(first: Concrete, second: Concrete) -> Concrete:
    return f"{first}{second}"


def _text_of(value: Concrete) -> Concrete:
    """The text of a number, a truth value or a position, as deployed robots have it."""
    match value:
        case bool():
            return "true" if value else "false"
        case Fraction():
            return repr(float(value))
        case Rec(fields=fields):
            return f"({', '.join(str(_text_of(part)) for part in fields)})"
        case _:
            return repr(value)


_HOSTS: dict[tuple[str, tuple[Type | str, ...], Type | str], Host] = {
    ("sqrt", (FLOAT,), FLOAT): _sqrt,
    ("sin", (FLOAT,), FLOAT): _on_doubles(math.sin),
    ("cos", (FLOAT,), FLOAT): _on_doubles(math.cos),
    ("atan2", (FLOAT, FLOAT), FLOAT): _on_doubles(math.atan2),
    ("joinedText", (STRING, STRING), STRING): _joined_text,
    ("textOf", (INT,), STRING): _text_of,
    ("textOf", (FLOAT,), STRING): _text_of,
    ("textOf", (BOOL,), STRING): _text_of,
    ("textOf", (POS,), STRING): _text_of,
    ("findPath", (POS, POS), _PATH): _find_path,
    ("findPath", (POS, POS, _PATH), _PATH): _find_path,
    ("getPathFromTask", ("Task",), _PATH): _path_to_task,
    ("getPathFromTask", (POS, "Task"), _PATH): _path_from_to_task,
    ("pathsClear", (_PATH, _PATH), BOOL): _paths_clear,
    ("onPath", (POS, _PATH), BOOL): _on_path,
    ("apart", (POS, POS), BOOL): _apart,
    ("willCollide", ("Task",), BOOL): _will_not_collide,
    ("scanToMap", (_PATH,), _MAP): _scan_to_map,
    ("pickFrontierPos", (_MAP, POS), POS): _frontier,
    ("findObs", (_MAP,), _PATH): _obstacles,
}


#: How far a vehicle comes in a round.
STEP_M = Fraction(1)

_MOTION = frozenset({"Motion", "MotionWithScan"})

#: Actuators that say where to go, the most telling first.
_GOALS = ("path", "route", "target")


def driven(
    sampler: Sampler, agent: core.Agent, module: core.Module, state: Robot[Constant]
) -> dict[int, Concrete]:
    """The readings of a module's sensors by slot; none for unknown modules."""
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
    """The path or target that the robot's program has set as its goal, or None."""
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
