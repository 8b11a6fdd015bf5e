"""Machine code of a car's direct ways: the shortest curve of Reeds and Shepp, and its points.

The formulas are those of the paper (Reeds, Shepp 1990, "Optimal paths for a car that goes both
forwards and backwards"), in the order of operations of OMPL, and sines, cosines and arcs are those
of the system's library, which OMPL calls. So the points are to the last bit those that
:class:`.CurvePlanner` finds by asking OMPL, and tests hold the two together. *Sure, or in doubt*:
where a wall may be near, or a curve is odd, nothing is said, and OMPL is asked.

Curves are computed for circles of radius 1 about a car at the origin that points along x. A curve
is up to five pieces, each with a length in radians or radii, negative where it is driven backwards.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from msgspec import Struct

from koord.machine.code import F64, I64, Ir, new_module, real, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.curves import CHECK_M, CUSP_M, ROUNDING_M, SPACING_M
from koord.runtime.motion.real_code import RealCode, library

#: Numbers that the machine code is given. ``keeps_m`` is what places keep from the edge,
#: and ``z`` the height of all points.
_NUMBERS = (
    *("x", "y", "heading", "goal_x", "goal_y", "radius", "west", "south", "east", "north"),
    *("keeps_m", "z"),
)

#: Pieces of a curve, and cusps that it may have: there are two at most, and one for each rounding.
_PIECES, _CUSPS = 5, 8

#: A block of memory of a curve: where each entry begins, in doubles. Behind each piece stand where
#: it begins, with the direction, and its sine and cosine.
_TOTAL, _SIZE, _LENGTHS, _TURNS = 0, 1, 2, 2 + _PIECES
_STATES, _STATE = _TURNS + _PIECES, 5
_START = _STATES + _STATE * (_PIECES + 1)
_END, _RADIUS, _LENGTH_M = _START + 3, _START + 6, _START + 7
_WAY, _UNTIL, _FOUND, _DOUBT, _AT = (_LENGTH_M + k for k in range(1, 6))
_BLOCK = _AT + _CUSPS

#: What the library that is copied takes for nothing, and a distance that hides no rounding.
_NOTHING, _CLOSE_M = 10 * 2.0**-52, 1e-11

#: What a curve must be shorter by than the best so far is less than this share of it.
_SLACK = 1 + 1e-12

#: The longest curve of which points are computed here, in m.
_LONGEST_M = 300.0

#: The most points that come of it.
_POINTS = math.ceil(_LONGEST_M / SPACING_M) + 2 * (_CUSPS + 2)

_LEFT, _STRAIGHT, _RIGHT = 1.0, 0.0, -1.0


class DirectWays:
    """Finds direct ways of cars: free curves of Reeds and Shepp that nothing is near."""

    def __init__(self, headings: Sequence[float], library: Ints) -> None:
        """``headings`` are those in which a car may arrive, from -π to π."""
        self._headings, self._library = tuple(headings), library
        self._rooms = threading.local()
        self._find = _direct(len(headings))

    def find(
        self,
        start: tuple[float, float, float],
        goal: tuple[float, float],
        radius_m: float,
        edges: tuple[float, float, float, float],
        keeps_m: float,
        z: float,
    ) -> Floats | None:
        """Find the points of the shortest curve to a goal, shape ``(k, 3)``; None: in doubt.

        ``start`` is x, y and a heading from -π to π, ``edges`` the least x and y of the world and
        the greatest, from which all places on the way keep more than ``keeps_m``.
        """
        room = self._room()
        room.numbers[: len(_NUMBERS)] = *start, *goal, radius_m, *edges, keeps_m, z
        count = self._find(*room.addresses)
        return room.points[:count].copy() if count else None

    def _room(self) -> _Room:
        """The memory of this thread, in which one way is found after the other."""
        found: _Room | None = getattr(self._rooms, "room", None)
        if found is None:
            found = self._rooms.room = _Room(self._library, self._headings)
        return found


class _Room:
    """Memory for finding a way: what is asked, and what is found."""

    def __init__(self, library: Ints, headings: Sequence[float]) -> None:
        self.numbers: Floats = np.array([*(0.0 for _ in _NUMBERS), *headings])
        self.points: Floats = np.empty((_POINTS, 3))
        arrays = library, self.numbers, self.points
        self.addresses: tuple[int, ...] = tuple(array.ctypes.data for array in arrays)


def direct_ways(headings: tuple[float, ...]) -> DirectWays | None:
    """What finds direct ways in one of some headings; None if it cannot be made here."""
    functions = library()
    return None if functions is None else DirectWays(headings, functions)


# --- the machine code -----------------------------------------------------------------------------


@cache
def _direct(headings: int) -> Callable[..., int]:
    """Compile the search for the shortest curve, and its points.

    The function takes the addresses of the library, of numbers, and of room for points; it returns
    how many there are, and 0 in doubt.
    """
    return kept("curves", (headings,), lambda: _module(headings)).function("direct", 3)


def _module(headings: int) -> Ir:
    module = new_module("curves")
    shapes = [_Shape(module, name) for name in _FORMULAS]
    shortest = _write_shortest(module, dict(zip(_FORMULAS, shapes, strict=True)))
    at = _write_at(module)
    pieces = _write_pieces(module, at)
    _write_direct(module, headings, shortest, at, pieces)
    return module


class _Shape:
    """The function of a formula: t, u and v of a curve of its kind, if there is one.

    It takes where they are put; x, y and direction of the goal, the sine and cosine of that, and
    what the curve must be shorter than. It returns whether there is such a curve.
    """

    def __init__(self, module: Ir, name: str) -> None:
        body = self.body = RealCode(module, name, 1, 6)
        self.x, self.y, self.phi, self.sine, self.cosine, self.most = body.numbers
        body.code.function.linkage = "internal"
        _FORMULAS[name](self)
        self.function = body.code.function

    def needs(self, condition: Ir) -> None:
        """There is no such curve where a condition does not hold."""
        self.body.leave(self.body.b.not_(condition))

    def not_below(self, number: Lane) -> None:
        """A number must not be less than nothing."""
        self.needs(self.body.number(-_NOTHING).is_at_most(number))

    def not_above(self, number: Lane) -> None:
        self.needs(number.is_at_most(_NOTHING))

    def shorter(self, u: Lane) -> None:
        """A part of the curve must be shorter than all of it may be: else no more is computed."""
        self.needs(self.body.size(u).is_below(self.most))

    def found(self, t: Lane, u: Lane, v: Lane) -> None:
        for k, number in enumerate((t, u, v)):
            self.body.put(self.body.blocks[0], k, number)
        self.body.b.ret(word(1))

    def same_side(self) -> tuple[Lane, Lane]:
        """Where the middle of the last circle is, if it is on the side of the first one."""
        return self.x - self.sine, self.y - 1.0 + self.cosine

    def other_side(self) -> tuple[Lane, Lane]:
        return self.x + self.sine, self.y - 1.0 - self.cosine

    def turns(self, u: Lane, v: Lane, xi: Lane, eta: Lane) -> tuple[Lane, Lane]:
        """The first and the last turn of curves of four circles. (8.5, 8.6)"""
        body = self.body
        delta = body.unwound(u - v)
        (sine, cosine), (sine_u, cosine_u) = body.sine_cosine(delta), body.sine_cosine(u)
        a, b = sine_u - sine, cosine_u - cosine - 1.0
        first = body.call("atan2", eta * a - xi * b, xi * a + eta * b)
        ahead = 2.0 * (cosine - body.call("cos", v) - cosine_u) + 3.0
        back = (first + math.pi).where(ahead.is_below(0.0), first)
        tau = body.unwound(back)
        return tau, body.unwound(tau - u + v - self.phi)


def _size(x: Lane, y: Lane) -> Lane:
    return (x * x + y * y).sqrt()


def _lsl(of: _Shape) -> None:
    """L+ S+ L+. (8.1)"""
    xi, eta = of.same_side()
    u = _size(xi, eta)
    of.shorter(u)
    t = of.body.call("atan2", eta, xi)
    of.not_below(t)
    v = of.body.unwound(of.phi - t)
    of.not_below(v)
    of.found(t, u, v)


def _lsr(of: _Shape) -> None:
    """L+ S+ R+. (8.2)"""
    xi, eta = of.other_side()
    size = _size(xi, eta)
    square = size * size
    of.needs(of.body.number(4.0).is_at_most(square))
    u = (square - 4.0).sqrt()
    of.shorter(u)
    theta = of.body.call("atan2", of.body.number(2.0), u)
    t = of.body.unwound(of.body.call("atan2", eta, xi) + theta)
    of.not_below(t)
    v = of.body.unwound(t - of.phi)
    of.not_below(v)
    of.found(t, u, v)


def _lrl(of: _Shape) -> None:
    """L+ R- L, the last either way. (8.3, 8.4)"""
    xi, eta = of.same_side()
    size = _size(xi, eta)
    of.needs(size.is_at_most(4.0))
    u = -2.0 * of.body.call("asin", 0.25 * size)
    of.shorter(u)
    t = of.body.unwound(of.body.call("atan2", eta, xi) + 0.5 * u + math.pi)
    of.not_below(t)
    of.not_above(u)
    of.found(t, u, of.body.unwound(of.phi - t + u))


def _lrlr_about(of: _Shape) -> None:
    """L+ R+ L- R-. (8.7)"""
    xi, eta = of.other_side()
    rho = 0.25 * (2.0 + _size(xi, eta))
    of.needs(rho.is_at_most(1.0))
    u = of.body.call("acos", rho)
    of.shorter(u)
    t, v = of.turns(u, -u, xi, eta)
    of.not_below(t)
    of.not_above(v)
    of.found(t, u, v)


def _lrlr_between(of: _Shape) -> None:
    """L+ R- L- R+. (8.8)"""
    xi, eta = of.other_side()
    rho = (20.0 - xi * xi - eta * eta) / 16.0
    of.needs(of.body.number(0.0).is_at_most(rho))
    of.needs(rho.is_at_most(1.0))
    u = -of.body.call("acos", rho)
    of.shorter(u)
    of.needs(of.body.number(-0.5 * math.pi).is_at_most(u))
    t, v = of.turns(u, u, xi, eta)
    of.not_below(t)
    of.not_below(v)
    of.found(t, u, v)


def _lrsl(of: _Shape) -> None:
    """L+ R- S- L-, the second a quarter. (8.9)"""
    xi, eta = of.same_side()
    rho = _size(xi, eta)
    of.needs(of.body.number(2.0).is_at_most(rho))
    rest = (rho * rho - 4.0).sqrt()
    u = 2.0 - rest
    of.not_above(u)
    of.shorter(u)
    theta = of.body.call("atan2", eta, xi)
    t = of.body.unwound(theta + of.body.call("atan2", rest, of.body.number(-2.0)))
    of.not_below(t)
    v = of.body.unwound(of.phi - 0.5 * math.pi - t)
    of.not_above(v)
    of.found(t, u, v)


def _lrsr(of: _Shape) -> None:
    """L+ R- S- R-, the second a quarter. (8.10)"""
    xi, eta = of.other_side()
    aside = -eta
    rho = _size(aside, xi)
    of.needs(of.body.number(2.0).is_at_most(rho))
    u = 2.0 - rho
    of.not_above(u)
    of.shorter(u)
    t = of.body.call("atan2", xi, aside)
    of.not_below(t)
    v = of.body.unwound(t + 0.5 * math.pi - of.phi)
    of.not_above(v)
    of.found(t, u, v)


def _lrslr(of: _Shape) -> None:
    """L+ R- S- L- R+, the second and the fourth a quarter. (8.11)"""
    xi, eta = of.other_side()
    rho = _size(xi, eta)
    of.needs(of.body.number(2.0).is_at_most(rho))
    u = 4.0 - (rho * rho - 4.0).sqrt()
    of.not_above(u)
    of.shorter(u)
    across, along = (4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta
    t = of.body.unwound(of.body.call("atan2", across, along))
    of.not_below(t)
    v = of.body.unwound(t - of.phi)
    of.not_below(v)
    of.found(t, u, v)


_FORMULAS: dict[str, Callable[[_Shape], None]] = {
    "lsl": _lsl,
    "lsr": _lsr,
    "lrl": _lrl,
    "lrlr_about": _lrlr_about,
    "lrlr_between": _lrlr_between,
    "lrsl": _lrsl,
    "lrsr": _lrsr,
    "lrslr": _lrslr,
}


class _Kind(Struct, frozen=True):
    """A kind of curves: its formula, where its pieces turn to, and their lengths.

    Lengths are t, u and v with a sign, or quarters of a circle. Those that are ``backwards`` are
    curves from the goal, in reverse order.
    """

    formula: str
    pieces: str
    lengths: str
    backwards: bool = False


#: What curves have besides t, u and v; kinds that have as much are looked at together.
_GROUPS: tuple[tuple[float, tuple[_Kind, ...]], ...] = (
    (0.0, (_Kind("lsl", "LSL", "tuv"), _Kind("lsr", "LSR", "tuv"))),
    (0.0, (_Kind("lrl", "LRL", "tuv"), _Kind("lrl", "LRL", "vut", backwards=True))),
    (0.0, (_Kind("lrlr_about", "LRLR", "tuUv"), _Kind("lrlr_between", "LRLR", "tuuv"))),
    (
        0.5 * math.pi,
        (
            _Kind("lrsl", "LRSL", "tquv"),
            _Kind("lrsr", "LRSR", "tquv"),
            _Kind("lrsl", "LSRL", "vuqt", backwards=True),
            _Kind("lrsr", "RSRL", "vuqt", backwards=True),
        ),
    ),
    (math.pi, (_Kind("lrslr", "LRSLR", "tquqv"),)),
)

_TURN_OF = {"L": _LEFT, "S": _STRAIGHT, "R": _RIGHT}


def _write_shortest(module: Ir, shapes: dict[str, _Shape]) -> Ir:
    """Write the search for the shortest curve of all kinds.

    The function takes the block of a curve; x, y and direction of the goal, and what the curve must
    be shorter than. It returns whether there is one. Of equal ones the first counts.
    """
    body = RealCode(module, "shortest", 1, 4)
    body.code.function.linkage = "internal"
    (curve,), (x, y, phi, most) = body.blocks, body.numbers
    code, b = body.code, body.b
    sine, cosine = body.sine_cosine(phi)
    back_x, back_y = x * cosine + y * sine, x * sine - y * cosine
    parts, found = code.block(3 * DOUBLE_BYTES), code.slot(I64)
    least, total = body.slot(most), body.slot(most)
    b.store(word(0), found)
    for more, kinds in _GROUPS:
        body.set(least, body.of(total) - more if more else body.of(total))
        for kind in kinds:
            goal = (back_x, back_y) if kind.backwards else (x, y)
            # As it is, in time reversed, reflected, and both.
            with code.loop(word(0), word(4)) as flip:
                odd = b.icmp_signed("!=", b.and_(flip, word(1)), word(0))
                mirrored = b.icmp_signed("!=", b.and_(flip, word(2)), word(0))
                one = body.number(1.0)
                time, side = (-one).where(odd, one), (-one).where(mirrored, one)
                turned = time * side
                arguments = (time * goal[0], side * goal[1], turned * phi, turned * sine, cosine)
                given = [one.ir for one in (*arguments, body.of(least))]
                there = b.call(shapes[kind.formula].function, [body.library, parts, *given])
                with code.only_if(b.icmp_signed("!=", there, word(0))):
                    t, u, v = (body.get(parts, k) for k in range(3))
                    twice = 2.0 if len(kind.lengths.lower()) == 4 and not more else 1.0
                    length = body.size(t) + twice * body.size(u) + body.size(v)
                    with code.only_if(length.is_below(body.of(least))):
                        body.set(least, length)
                        b.store(word(1), found)
                        _put_curve(body, curve, kind, (t, u, v), (time, side))
                        body.set(total, body.get(curve, _TOTAL))
    b.ret(b.load(found))
    return code.function


def _put_curve(
    body: RealCode, curve: Ir, kind: _Kind, parts: Sequence[Lane], signs: tuple[Lane, Lane]
) -> None:
    """Store the pieces of a curve, and its length."""
    (t, u, v), (time, side) = parts, signs
    lengths = {"t": t, "u": u, "U": -u, "v": v, "q": body.number(-0.5 * math.pi)}
    total = None
    for k, (piece, name) in enumerate(zip(kind.pieces, kind.lengths, strict=True)):
        length = time * lengths[name]
        body.put(curve, _LENGTHS + k, length)
        body.put(curve, _TURNS + k, side * _TURN_OF[piece])
        total = body.size(length) if total is None else total + body.size(length)
    assert total is not None
    body.put(curve, _TOTAL, total)
    body.put_whole(curve, _SIZE, word(len(kind.pieces)))


def _moved(body: RealCode, state: Sequence[Lane], turn: Lane, v: Lane) -> list[Lane]:
    """Where a car is after a piece of a circle to the left or right, or of a line; no state is NaN.

    A state is x, y, direction, and the sine and cosine of that.
    """
    x, y, phi, sine, cosine = state
    is_line = body.b.fcmp_ordered("==", turn.ir, real(0.0))
    is_left = body.number(0.0).is_below(turn)
    course = phi.where(is_line, (phi + v).where(is_left, phi - v))
    after = [body.slot(sine), body.slot(cosine)]
    with body.code.only_if(body.b.not_(is_line)):
        for slot, number in zip(after, body.sine_cosine(course), strict=True):
            body.set(slot, number)
    to_sine, to_cosine = (body.of(slot) for slot in after)
    left = x + to_sine - sine, y - to_cosine + cosine
    right = x - to_sine + sine, y + to_cosine - cosine
    line = x + v * cosine, y + v * sine
    place = [
        a.where(is_line, b.where(is_left, c)) for a, b, c in zip(line, left, right, strict=True)
    ]
    return [*place, course, to_sine, to_cosine]


def _write_states(body: RealCode, curve: Ir) -> None:
    """Store where each piece of a curve begins, and where the last ends."""
    zero, heading = body.number(0.0), body.get(curve, _START + 2)
    for k, number in enumerate((zero, zero, heading, *body.sine_cosine(heading))):
        body.put(curve, _STATES + k, number)
    with body.code.loop(word(0), body.whole(curve, _SIZE)) as piece:
        first = body.b.mul(piece, word(_STATE))
        state = [body.get(curve, _STATES + k, first) for k in range(_STATE)]
        turn, length = body.get(curve, _TURNS, piece), body.get(curve, _LENGTHS, piece)
        for k, number in enumerate(_moved(body, state, turn, length)):
            body.put(curve, _STATES + _STATE + k, number, first)


def _write_at(module: Ir) -> Ir:
    """Write where a car is at a share of a curve: the function takes its block, and room for it."""
    body = RealCode(module, "at", 2, 1)
    body.code.function.linkage = "internal"
    (curve, out), (share,), b = body.blocks, body.numbers, body.b
    for entry, there in (
        (_END, body.number(1.0).is_at_most(share)),
        (_START, share.is_at_most(0.0)),
    ):
        with body.leaves(there, word(0)):
            for k in range(3):
                body.put(out, k, body.get(curve, entry + k))
    size = body.whole(curve, _SIZE)
    left, piece = body.slot(share * body.get(curve, _TOTAL)), body.code.slot(I64)
    b.store(word(0), piece)

    def is_passed() -> Ir:
        now = b.load(piece)
        inside = b.icmp_signed("<", now, size)
        there = b.select(inside, now, word(0))
        goes_on = body.number(0.0).is_below(body.of(left))
        passed = body.size(body.get(curve, _LENGTHS, there)).is_at_most(body.of(left))
        return b.and_(inside, b.and_(goes_on, passed))

    with body.code.while_(is_passed):
        now = b.load(piece)
        body.set(left, body.of(left) - body.size(body.get(curve, _LENGTHS, now)))
        b.store(b.add(now, word(1)), piece)
    now = b.load(piece)
    first = b.mul(now, word(_STATE))
    state = [body.get(curve, _STATES + k, first) for k in range(_STATE)]
    slots = [body.slot(number) for number in state[:3]]
    is_on = b.and_(b.icmp_signed("<", now, size), body.number(0.0).is_below(body.of(left)))
    with body.code.only_if(is_on):
        turn, length = body.get(curve, _TURNS, now), body.get(curve, _LENGTHS, now)
        moved = _moved(body, state, turn, body.of(left).signed_as(length))
        for slot, number in zip(slots, moved[:3], strict=True):
            body.set(slot, number)
    radius = body.get(curve, _RADIUS)
    x, y, heading = (body.of(slot) for slot in slots)
    body.put(out, 0, x * radius + body.get(curve, _START))
    body.put(out, 1, y * radius + body.get(curve, _START + 1))
    body.put(out, 2, heading)
    b.ret(word(0))
    return body.code.function


def _write_pieces(module: Ir, at: Ir) -> Ir:
    """Write what finds cusps in a piece of a curve, as ``curves._pieces``.

    The function takes the block of the curve, the shares at both ends, and the states there. Cusps
    are stored in the block.
    """
    body = RealCode(module, "pieces", 3, 2)
    function = body.code.function
    function.linkage = "internal"
    (curve, first, last), (begin, end), b = body.blocks, body.numbers, body.b
    x, y, heading = (body.get(first, k) for k in range(3))
    step_x, step_y = body.get(last, 0) - x, body.get(last, 1) - y
    radius, length = body.get(curve, _RADIUS), (end - begin) * body.get(curve, _LENGTH_M)
    half_turn = (length / (2.0 * radius)).lesser(math.pi / 2)
    arc_m = 2.0 * radius * body.call("sin", half_turn)
    far_m = arc_m - ROUNDING_M
    apart_m = _size(step_x, step_y)
    # Distances are rounded in another way than those that are copied.
    unsure = body.size(apart_m - far_m).is_below(_CLOSE_M)
    with body.code.only_if(unsure):
        body.put_whole(curve, _DOUBT, word(1))
    with body.leaves(far_m.is_at_most(apart_m), word(0)):
        sine, cosine = body.sine_cosine(heading)
        ahead = body.number(0.0).is_below(step_x * cosine + step_y * sine)
        going = body.number(1.0).where(ahead, -1.0)
        way = body.get(curve, _WAY)
        turns = body.b.fcmp_ordered("!=", way.ir, going.ir)
        turns = b.and_(turns, b.fcmp_ordered("!=", way.ir, real(0.0)))
        with body.code.only_if(turns):
            found = body.whole(curve, _FOUND)
            is_full = b.icmp_signed(">=", found, word(_CUSPS))
            with body.code.only_if(is_full):
                body.put_whole(curve, _DOUBT, word(1))
            place = b.select(is_full, word(0), found)
            body.put(curve, _AT, (body.get(curve, _UNTIL) + begin) / 2.0, place)
            body.put_whole(curve, _FOUND, b.add(place, word(1)))
        body.put(curve, _WAY, going)
        body.put(curve, _UNTIL, end)
    body.leave(length.is_at_most(CUSP_M))
    half = (begin + end) / 2.0
    middle = body.code.block(3 * DOUBLE_BYTES)
    b.call(at, [body.library, curve, middle, half.ir])
    b.call(function, [body.library, curve, first, middle, begin.ir, half.ir])
    b.call(function, [body.library, curve, middle, last, half.ir, end.ir])
    b.ret(word(0))
    return function


def _write_direct(module: Ir, headings: int, shortest: Ir, at: Ir, pieces: Ir) -> None:
    """Write the search for the shortest curve in any heading, its check, and its points."""
    body = RealCode(module, "direct", 2, 0)
    (numbers, points), b, code = body.blocks, body.b, body.code
    of = {name: body.get(numbers, k) for k, name in enumerate(_NUMBERS)}
    curve = _find_best(body, numbers, headings, of, shortest)
    length = body.get(curve, _LENGTH_M)
    body.leave(b.not_(length.is_below(_LONGEST_M)))
    # Whatever is no number is not free.
    body.leave(b.not_(body.number(0.0).is_below(length)))
    _write_states(body, curve)
    here = code.block(3 * DOUBLE_BYTES)

    def state_at(share: Lane, out: Ir = here) -> None:
        b.call(at, [body.library, curve, out, share.ir])

    def spare() -> Lane:
        x, y = body.get(here, 0), body.get(here, 1)
        least = (x - of["west"]).lesser(of["east"] - x)
        return least.lesser(y - of["south"]).lesser(of["north"] - y) - of["keeps_m"]

    along = body.slot(body.number(0.0))
    with code.while_(lambda: body.of(along).is_below(length)):
        state_at(body.of(along) / length)
        free = spare()
        body.leave(b.not_(body.number(0.0).is_below(free)))
        body.set(along, body.of(along) + free.greater(CHECK_M))
    state_at(body.number(1.0))
    body.leave(b.not_(body.number(0.0).is_below(spare())))
    _find_cusps(body, curve, length, state_at, pieces)
    body.leave(b.icmp_signed("!=", body.whole(curve, _DOUBT), word(0)))
    count = code.slot(I64)
    b.store(word(0), count)

    def add() -> None:
        first = b.mul(b.load(count), word(3))
        for k, value in enumerate((body.get(here, 0), body.get(here, 1), of["z"])):
            body.put(points, k, value, first)
        b.store(b.add(b.load(count), word(1)), count)

    state_at(body.number(0.0))
    add()
    cusps, first = body.whole(curve, _FOUND), body.slot(body.number(0.0))
    with code.loop(word(0), b.add(cusps, word(1))) as leg:
        is_last = b.icmp_signed("==", leg, cusps)
        there = b.select(is_last, word(0), leg)
        last = body.number(1.0).where(is_last, body.get(curve, _AT, there))
        begun = body.of(first)
        many = _counted(body, (last - begun) * length / SPACING_M - 1e-9)
        number = Lane(body.lanes, b.sitofp(many, F64))
        with code.loop(word(1), b.add(many, word(1))) as k:
            share = (last - begun) * Lane(body.lanes, b.sitofp(k, F64)) / number
            state_at(begun + share)
            add()
        body.set(first, last)
    b.ret(b.load(count))


def _counted(body: RealCode, number: Lane) -> Ir:
    """The least whole number that is not less than a number, and 1 at least."""
    found = body.b.fptosi(body.call("ceil", number).ir, I64)
    return body.b.select(body.b.icmp_signed("<", found, word(1)), word(1), found)


def _find_best(body: RealCode, numbers: Ir, headings: int, of: dict[str, Lane], shortest: Ir) -> Ir:
    """The block of the shortest curve: of equally long ones that of the first heading."""
    b, code = body.b, body.code
    step_x, step_y = of["goal_x"] - of["x"], of["goal_y"] - of["y"]
    sine, cosine = body.sine_cosine(of["heading"])
    radius = of["radius"]
    x = (cosine * step_x + sine * step_y) / radius
    y = (-sine * step_x + cosine * step_y) / radius
    best, other = (code.block(_BLOCK * DOUBLE_BYTES) for _ in range(2))
    length, least = body.slot(body.number(math.inf)), body.slot(body.number(math.inf))
    heading_at = len(_NUMBERS)
    with code.loop(word(0), word(headings)) as number:
        heading = body.get(numbers, heading_at, number)
        turned = heading - of["heading"]
        given = [one.ir for one in (x, y, turned, body.of(least))]
        there = b.call(shortest, [body.library, other, *given])
        with code.only_if(b.icmp_signed("!=", there, word(0))):
            total = body.get(other, _TOTAL)
            length_m = radius * total
            with code.only_if(length_m.is_below(body.of(length))):
                code.copy(best, other, _STATES * DOUBLE_BYTES)
                body.set(length, length_m)
                body.set(least, total * _SLACK)
                ends = (of["goal_x"], of["goal_y"], heading)
                for k, value in enumerate((of["x"], of["y"], of["heading"], *ends)):
                    body.put(best, _START + k, value)
    body.put(best, _RADIUS, radius)
    body.put(best, _LENGTH_M, body.of(length))
    return best


def _find_cusps(
    body: RealCode, curve: Ir, length: Lane, state_at: Callable[..., None], pieces: Ir
) -> None:
    """Find the shares of a curve at which the car turns about, as ``curves._cusps``."""
    b, code, zero = body.b, body.code, body.number(0.0)
    for entry in (_WAY, _UNTIL):
        body.put(curve, entry, zero)
    for entry in (_FOUND, _DOUBT):
        body.put_whole(curve, entry, word(0))
    count = _counted(body, length / SPACING_M)
    whole = Lane(body.lanes, b.sitofp(count, F64))
    ends = [code.block(3 * DOUBLE_BYTES) for _ in range(2)]
    state_at(zero, ends[0])
    with code.loop(word(0), count) as k:
        begin, end = (
            Lane(body.lanes, b.sitofp(number, F64)) / whole for number in (k, b.add(k, word(1)))
        )
        state_at(end, ends[1])
        b.call(pieces, [body.library, curve, *ends, begin.ir, end.ir])
        code.copy(ends[0], ends[1], 3 * DOUBLE_BYTES)
