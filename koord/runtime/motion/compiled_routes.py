"""Machine code of the measures of routes: legs, courses, curvatures and greatest speeds.

What :class:`.Routes` computes of the paths of cars, in the same order of operations, so that routes
are equal to the last bit. Courses of segments are left to NumPy, as they are there. Where it hangs
on the last bit whether a car turns about, or which way it sets out, :class:`.Routes` decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from koord.machine.code import I64, Ir, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.bodies import Pace
from koord.runtime.motion.real_code import RealCode, library
from koord.runtime.motion.routes import CORNER_RAD, REPEATED_M, Routes

#: Arrays of routes that are written, and numbers on the way to them, a row for each.
_ROUTES = ("points", "s", "speed2", "tangent", "course", "turn", "curvature", "leg_end", "way")
_WORK = ("step_x", "step_y", "flat", "length", "about")

#: Who is so near to where it is decided what a route is like is left to NumPy.
_CLOSE = 1e-9


class CompiledRoutes(Routes):
    """Routes of cars, measured by machine code that is made once in a process."""

    def __init__(self, count: int, pace: Pace, room: int = 2) -> None:
        super().__init__(count, pace, room)
        assert pace.cusp_rad < math.pi
        functions = library()
        assert functions is not None
        self._library, self._heading = functions, np.zeros(1)
        self._code = _measuring(pace)
        self._look()

    def _look(self) -> None:
        """Note where the arrays are, which are new ones when they have grown."""
        room = self.s.shape[1]
        self._known = self.points
        self._work: Floats = np.zeros((len(_WORK), room))
        arrays = (self._library, self._heading, self._work, *(getattr(self, k) for k in _ROUTES))
        self._table: Ints = np.array([array.ctypes.data for array in arrays], np.int64)
        self._table_at: int = self._table.ctypes.data

    def put(self, robot: int, path: Floats, heading_rad: float = 0.0) -> None:
        self._grow(len(path))
        if self.points is not self._known:
            self._look()
        path = np.ascontiguousarray(path)
        begin, measure = self._code
        room = self.s.shape[1]
        segments = begin(self._table_at, path.ctypes.data, robot, room, len(path))
        if segments:
            step_x, step_y, flat = self._work[:3, :segments]
            np.arctan2(step_y, step_x, out=flat)
            self._heading[0] = heading_rad
            if measure(self._table_at, robot, room, segments):
                self.size[robot] = segments
                self.length[robot] = self.s[robot, segments]
                self.given[robot] += 1
                self.changes += 1
                return
        super().put(robot, path, heading_rad)


def routes_of_cars(count: int, pace: Pace) -> Routes:
    """Routes by machine code, if it can be made here."""
    return Routes(count, pace) if library() is None else CompiledRoutes(count, pace)


# --- the machine code -----------------------------------------------------------------------------


@cache
def _measuring(pace: Pace) -> tuple[Callable[..., int], Callable[..., int]]:
    """Compile both parts of what is done with a path of a robot of a pace.

    The first takes the addresses of the table and of the path, the robot, how many points there is
    room for in each route, and how many the path has. It stores points that are not repeated, and
    steps between them, and returns how many steps there are. The second takes the table, the robot,
    the room and the number of steps; it returns 0 where NumPy is to decide.
    """

    def module() -> Ir:
        made = new_module("routes")
        _write_begin(made)
        _write_measure(made, pace)
        return made

    code = kept("routes", (pace,), module)
    return code.function("begin", 5), code.function("measure", 4)


class _Route(RealCode):
    """The body of a function about the route of a robot."""

    def open(self, table: Ir, robot: Ir, room: Ir) -> None:
        """Take the arrays from the table: what is of the robot, and what is its own work."""
        b, code = self.b, self.code
        names = ("library", "heading", "work", *_ROUTES)
        address = {k: code.get(table, DOUBLE_BYTES * n, I64) for n, k in enumerate(names)}
        self.arrays: dict[str, Ir] = {}
        row = b.mul(b.mul(robot, room), word(DOUBLE_BYTES))
        for name in _ROUTES:
            wide = 3 if name in ("points", "tangent") else 1
            self.arrays[name] = code.pointer(b.add(address[name], b.mul(row, word(wide))))
        for k, name in enumerate(_WORK):
            shift = b.mul(b.mul(word(k), room), word(DOUBLE_BYTES))
            self.arrays[name] = code.pointer(b.add(address["work"], shift))
        self.library = code.pointer(address["library"])
        self.heading = self.get(code.pointer(address["heading"]), 0)

    def at(self, name: str, index: Ir) -> Lane:
        return self.get(self.arrays[name], 0, index)

    def store(self, name: str, index: Ir, value: Lane) -> None:
        self.put(self.arrays[name], 0, value, index)

    def three(self, block: Ir, index: Ir) -> list[Lane]:
        first = self.b.mul(index, word(3))
        return [self.get(block, k, first) for k in range(3)]

    def store_three(self, name: str, index: Ir, values: list[Lane]) -> None:
        first = self.b.mul(index, word(3))
        for k, value in enumerate(values):
            self.put(self.arrays[name], k, value, first)

    def next(self, index: Ir) -> Ir:
        return self.b.add(index, word(1))

    def wrapped(self, angle: Lane) -> Lane:
        """As ``geometry.wrapped``."""
        whole = self.number(2 * math.pi)
        rest = self.call("fmod", angle + math.pi, whole)
        return (rest + whole).where(rest.is_below(0.0), rest) - math.pi


def _long(parts: list[Lane]) -> Lane:
    x, y, z = parts
    return (x * x + y * y + z * z).sqrt()


def _write_begin(module: Ir) -> None:
    body = _Route(module, "begin", whole=5)
    (table, path, robot, room, count), b, code = body.whole_numbers, body.b, body.code
    body.open(code.pointer(table), robot, room)
    path, last = code.pointer(path), b.sub(count, word(1))
    kept_ = code.slot(I64)
    b.store(word(0), kept_)
    with code.loop(word(0), last) as k:
        a, z = body.three(path, k), body.three(path, body.next(k))
        apart = _long([one - other for one, other in zip(z, a, strict=True)])
        with code.only_if(body.number(REPEATED_M).is_below(apart)):
            b.store(body.next(b.load(kept_)), kept_)
            body.store_three("points", b.load(kept_), z)
    with code.only_if(b.icmp_signed(">", count, word(0))):
        body.store_three("points", word(0), body.three(path, word(0)))
    segments = b.load(kept_)
    with code.loop(word(0), segments) as k:
        points = body.arrays["points"]
        a, z = body.three(points, k), body.three(points, body.next(k))
        way = [one - other for one, other in zip(z, a, strict=True)]
        length = _long(way)
        body.store("step_x", k, way[0])
        body.store("step_y", k, way[1])
        body.store("length", k, length)
        body.store_three("tangent", k, [part / length for part in way])
    b.ret(segments)


def _write_measure(module: Ir, pace: Pace) -> None:
    body = _Route(module, "measure", whole=4)
    (table, robot, room, segments), b, code = body.whole_numbers, body.b, body.code
    body.open(code.pointer(table), robot, room)
    end, zero = b.sub(segments, word(1)), body.number(0.0)
    _find_corners(body, pace, end)
    _sum_lengths(body, segments)
    _find_bends(body, segments)
    forwards = body.slot(body.number(1.0))
    if pace.reverses:
        ahead = body.call("cos", body.at("course", word(0)) - body.heading)
        body.leave(body.size(ahead).is_below(_CLOSE))
        body.set(forwards, body.number(1.0).where(zero.is_below(ahead), -1.0))
    cruise2 = pace.cruise_mps**2
    with code.loop(word(0), body.next(segments)) as k:
        bent = body.size(body.at("curvature", k)).greater(1e-9)
        limit = body.number(cruise2).lesser(pace.lateral_mps2 / bent)
        body.store("speed2", k, limit)
    with code.loop(word(0), end) as k, code.only_if(_is_corner(body, k)):
        body.store("speed2", body.next(k), zero)
    body.store("speed2", segments, zero)
    least, leg_end = body.slot(body.number(math.inf)), body.slot(body.at("s", segments))
    with code.loop(word(0), body.next(segments)) as back:
        k = b.sub(segments, back)
        gain = 2 * pace.accel_mps2 * body.at("s", k)
        here = (body.at("speed2", k) + gain).lesser(body.of(least))
        body.set(least, here)
        body.store("speed2", k, (here - gain).greater(0.0))
        with code.only_if(b.icmp_signed("<", k, end)), code.only_if(_is_corner(body, k)):
            body.set(leg_end, body.at("s", body.next(k)))
        body.store("leg_end", k, body.of(leg_end))
    with code.loop(word(0), segments) as k:
        body.store("way", k, body.of(forwards))
        if pace.reverses:
            with code.only_if(b.icmp_signed("<", k, end)), code.only_if(_is_corner(body, k)):
                body.set(forwards, -body.of(forwards))
        turn = body.at("turn", k) - body.at("course", k)
        body.store("turn", k, body.wrapped(turn))
    length, last = body.at("s", segments), body.three(body.arrays["points"], segments)
    with code.loop(body.next(segments), room) as k:
        body.store("s", k, length)
        body.store("leg_end", k, length)
        body.store("speed2", k, zero)
        body.store_three("points", k, last)
    b.ret(word(1))


def _is_corner(body: _Route, k: Ir) -> Ir:
    """Whether a car turns about behind a segment."""
    return body.number(0.5).is_below(body.at("about", k))


def _find_corners(body: _Route, pace: Pace, end: Ir) -> None:
    """Find where the car turns about; leave the function where that is not sure."""
    code, least = body.code, math.cos(pace.cusp_rad)
    tangent = body.arrays["tangent"]
    with code.loop(word(0), end) as k:
        (ax, ay, az), (zx, zy, zz) = body.three(tangent, k), body.three(tangent, body.next(k))
        along = ax * zx + ay * zy + az * zz
        body.leave(body.size(along - least).is_below(_CLOSE))
        about = body.number(1.0).where(along.is_below(least), 0.0)
        body.store("about", k, about)


def _sum_lengths(body: _Route, segments: Ir) -> None:
    total = body.slot(body.number(0.0))
    body.store("s", word(0), body.number(0.0))
    with body.code.loop(word(0), segments) as k:
        body.set(total, body.of(total) + body.at("length", k))
        body.store("s", body.next(k), body.of(total))


def _find_bends(body: _Route, segments: Ir) -> None:
    """Store courses where segments begin and, in place of turns, where they end; curvatures."""
    code, b = body.code, body.b
    end, zero = b.sub(segments, word(1)), body.number(0.0)
    body.store("curvature", segments, zero)
    with code.loop(word(0), segments) as k:
        body.store("curvature", k, zero)
        for name in ("course", "turn"):
            body.store(name, k, body.at("flat", k))
    is_first = code.slot(I64)
    b.store(word(1), is_first)
    with code.loop(word(0), end) as k:
        corner, then = _is_corner(body, k), body.next(k)
        with code.only_if(corner):
            b.store(word(1), is_first)
        with code.only_if(b.not_(corner)):
            flat, length, after = body.at("flat", k), body.at("length", k), body.at("length", then)
            turn = body.wrapped(body.at("flat", then) - flat)
            both = length + after
            bend = 2.0 * turn / both
            there = flat + length / both * turn
            body.store("course", then, there)
            body.store("turn", k, there)
            body.store("curvature", then, bend)
            is_bend = body.size(turn).is_below(CORNER_RAD)
            begins = b.icmp_signed("!=", b.load(is_first), word(0))
            with code.only_if(b.and_(begins, is_bend)):
                body.store("curvature", k, bend)
                body.store("course", k, flat - bend * length / 2.0)
            b.store(word(0), is_first)
            inside = b.icmp_signed("<", then, end)
            ends = b.or_(b.not_(inside), _is_corner(body, b.select(inside, then, k)))
            with code.only_if(b.and_(ends, is_bend)):
                body.store("curvature", b.add(k, word(2)), bend)
                body.store("turn", then, body.at("flat", then) + bend * after / 2.0)
