"""Machine code of rounds in which nobody acts: one after the other, until something is to be seen.

In the first robots may have acted already; then only what comes after that is made.

It puts together the machine code that there is for each part of such a round: guards, ticks, what
is measured of robots, the watchman's look, what sensors read, and claims. Before each round the
state is kept; where something comes of it that Python is to look at, the state is as before that
round, and Python makes it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

from koord.machine.code import BYTES, F64, I8, I64, WORD_BYTES, Code, Ir, constant, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.compile.machine.made import MORE_OF_CLAIMS, MORE_OF_TURNS, STATE_WORDS
from koord.sim.standing_kernel import NOBODY, SOMEBODY

#: What the machine code is given in a table: numbers and addresses, in this order.
#:
#: ``guards`` and ``looks`` are calls, each with the address of the function and its arguments;
#: ``kept`` are blocks of memory: where each is, where it is kept, and how many bytes it has.
TABLE = (
    *("count", "ticks", "steps", "room", "state"),
    *("guards", "guard_count", "looks", "look_count", "kept", "kept_count"),
    *("tick", "squad", "measure", "watch"),
    *("times", "places", "short", "began", "ended"),
    *("last", "ways", "pairs", "pair_count", "since", "found", "is_listed", "limits"),
    *("squares", "nearest", "automata", "stopped", "lingering", "lingering_s", "moments"),
    *("reached", "heard", "heard_count", "seen", "seen_count"),
    *("tilts", "all_states", "all_tilts", "heading", "all_headings", "all_reached"),
)

#: Numbers of a call of a guard and of a look: the function, and what it is given behind the state.
GUARD_WORDS, LOOK_WORDS = 1 + MORE_OF_TURNS, 1 + MORE_OF_CLAIMS

#: Numbers of what is told of blocks, of positions, and of whether robots have arrived.
KEPT_WORDS, SEEN_WORDS, HEARD_WORDS = 3, 5, 3

#: Entries of the table of a squad that are other arrays in each round.
MOVING = ("times", "places", "short")

_PLACE = 3 * DOUBLE_BYTES


def address_of(function: Callable[..., int]) -> int:
    """Where a function of machine code begins."""
    found = ctypes.cast(function, ctypes.c_void_p).value  # type: ignore[arg-type]
    assert found is not None
    return found


@cache
def striding_code(moving: tuple[int, ...]) -> Callable[..., int]:
    """Compile rounds; ``moving`` are the places of :data:`MOVING` in the table of a squad.

    The function takes the address of the table, how many rounds are to be made at most, and in how
    many of them, the first or none, robots have acted. It says how many were made.
    """
    return kept("striding", (moving,), lambda: _striding(moving)).function("stride", 3)


def _striding(moving: tuple[int, ...]) -> Ir:
    code = Code(new_module("striding"), "stride", [BYTES, I64, I64], I64)
    table, rounds, acted = code.arguments
    one = _Stride(code, table, moving)
    b = code.b
    done, ending = code.slot(I64), b.append_basic_block("ending")
    b.store(word(0), done)
    one.unless(one.is_unsure(), ending)
    with code.while_(lambda: b.icmp_signed("<", b.load(done), rounds)):
        now = b.load(done)
        with code.only_if(b.icmp_signed(">=", now, acted)):
            one.unless(one.is_enabled(), ending)
        one.keep(back=False)
        undone = b.append_basic_block("undone")
        with b.goto_block(undone):
            one.keep(back=True)
            b.branch(ending)
        is_last = one.round(now, acted, undone)
        b.store(b.add(now, word(1)), done)
        one.unless(is_last, ending)
    b.branch(ending)
    b.position_at_end(ending)
    b.ret(b.load(done))
    return code.function.module


class _Stride:
    """What is done in a round."""

    def __init__(self, code: Code, table: Ir, moving: tuple[int, ...]) -> None:
        self.code, self.b, self.lanes = code, code.b, Lanes(code, 1)
        self.of = {name: code.get(table, WORD_BYTES * k, I64) for k, name in enumerate(TABLE)}
        self.moving = dict(zip(MOVING, moving, strict=True))
        self.last = code.slot(I64)
        self.b.store(self.of["last"], self.last)
        self.count = self.of["count"]
        state = self.at("state")
        self.state = [code.get(state, WORD_BYTES * k, I64) for k in range(STATE_WORDS)]

    # --- memory and calls -----------------------------------------------------------------------

    def at(self, name: str, offset: Ir | None = None) -> Ir:
        """The address of an array, or of something some bytes behind its start."""
        address = self.of[name] if offset is None else self.b.add(self.of[name], offset)
        return self.b.inttoptr(address, BYTES)

    def by(self, number: Ir, size: Ir | int) -> Ir:
        return self.b.mul(number, word(size) if isinstance(size, int) else size)

    def unless(self, is_over: Ir, ending: Ir) -> None:
        """Go on elsewhere if something holds."""
        on = self.b.append_basic_block("on")
        self.b.cbranch(is_over, ending, on)
        self.b.position_at_end(on)

    def any_of(self, calls: str, count: str, words: int) -> Ir:
        """Whether one of some calls finds anybody: the first that does is the last."""
        code, b = self.code, self.b
        number, found = code.slot(I64), code.slot(I64)
        b.store(word(0), number)
        b.store(word(0), found)

        def goes_on() -> Ir:
            nobody = b.icmp_signed("==", b.load(found), word(0))
            return b.and_(nobody, b.icmp_signed("<", b.load(number), self.of[count]))

        with code.while_(goes_on):
            at = self.at(calls, self.by(b.load(number), WORD_BYTES * words))
            function, *arguments = code.words(at, words)
            b.store(self.code.called(function, [*self.state, *arguments]), found)
            b.store(b.add(b.load(number), word(1)), number)
        return b.icmp_signed("!=", b.load(found), word(0))

    # --- parts of a round -----------------------------------------------------------------------

    def is_enabled(self) -> Ir:
        """Whether an event is enabled, or may be."""
        return self.any_of("guards", "guard_count", GUARD_WORDS)

    def is_unsure(self) -> Ir:
        """Whether a claim may not hold."""
        return self.any_of("looks", "look_count", LOOK_WORDS)

    def keep(self, *, back: bool) -> None:
        """Keep the state, or let it be what was kept."""
        code, b = self.code, self.b
        with code.loop(word(0), self.of["kept_count"]) as number:
            at = self.at("kept", self.by(number, WORD_BYTES * KEPT_WORDS))
            here, there, size = code.words(at, KEPT_WORDS)
            to, source = (here, there) if back else (there, here)
            words = b.udiv(size, word(WORD_BYTES))
            self.copy(to, source, word(0), words, I64, WORD_BYTES)
            self.copy(to, source, self.by(words, WORD_BYTES), size, I8, 1)

    def copy(self, to: Ir, source: Ir, first: Ir, end: Ir, type_: Ir, size: int) -> None:
        """Copy numbers, from the first on, that have so many bytes."""
        code, b = self.code, self.b
        with code.loop(first, end) as index:
            offset = self.by(index, size)
            value = code.get(b.inttoptr(b.add(source, offset), BYTES), 0, type_)
            code.put(b.inttoptr(b.add(to, offset), BYTES), 0, value)

    def round(self, now: Ir, acted: Ir, undone: Ir) -> Ir:
        """Make a round, and go to ``undone`` where Python is to make it.

        Says whether it is to be the last: a robot has arrived in it, or is no longer where it was
        to go, and none has ``acted`` in it, or nobody goes any more.
        """
        b, count, ticks = self.b, self.count, self.of["ticks"]
        first = self.by(now, ticks)
        places = b.add(self.of["places"], self.by(first, self.by(count, _PLACE)))
        short = b.add(self.of["short"], self.by(now, self.by(count, DOUBLE_BYTES)))
        times = b.add(self.of["times"], self.by(first, DOUBLE_BYTES))
        for name, value in (("times", times), ("places", places), ("short", short)):
            self.code.put(self.at("squad"), WORD_BYTES * self.moving[name], value)
        given = [self.of[name] for name in ("squad", "count", "room", "ticks", "steps")]
        in_doubt = self.code.called(self.of["tick"], given)
        self.unless(b.icmp_signed("!=", in_doubt, word(0)), undone)
        self.measure(first, places, undone)
        arrived = self.hear()
        some = self.watch(now, short, arrived, undone)
        self.see(undone)
        self.unless(self.is_unsure(), undone)
        words = self.by(count, WORD_BYTES)
        states = b.add(self.of["all_states"], self.by(now, words))
        self.copy(states, self.of["automata"], word(0), count, I64, WORD_BYTES)
        headings = b.add(self.of["all_headings"], self.by(now, words))
        self.copy(headings, self.of["heading"], word(0), count, I64, WORD_BYTES)
        tilts = b.add(self.of["all_tilts"], self.by(now, self.by(count, _PLACE)))
        self.copy(tilts, self.of["tilts"], word(0), self.by(count, 3), I64, WORD_BYTES)
        reached = b.add(self.of["all_reached"], self.by(now, count))
        self.copy(reached, self.of["reached"], word(0), count, I8, 1)
        return b.and_(arrived, b.or_(b.icmp_signed(">=", now, acted), b.not_(some)))

    def measure(self, first: Ir, places: Ir, undone: Ir) -> None:
        """Measure after each tick; who is too near, or may be listed anew, is Python's."""
        code, b, lanes = self.code, self.b, self.lanes
        safety_m, reach_m = (lanes.get(self.at("limits"), DOUBLE_BYTES * k) for k in range(2))
        with code.loop(word(0), self.of["ticks"]) as tick:
            here = b.add(places, self.by(tick, self.by(self.count, _PLACE)))
            given = [self.of[name] for name in ("ways", "count", "pairs", "pair_count")]
            given = [here, b.load(self.last), *given, self.of["since"], self.of["found"]]
            which = self.code.called(self.of["measure"], given)
            b.store(here, self.last)
            square, moved2 = (lanes.get(self.at("found"), DOUBLE_BYTES * k) for k in range(2))
            place = self.by(b.add(first, tick), DOUBLE_BYTES)
            lanes.put(self.at("squares"), place, square)
            code.put(self.at("nearest"), place, which)
            distance = square.sqrt()
            is_sure = distance.is_below(reach_m - 2.0 * moved2.sqrt() - 1e-9)
            is_listed = b.icmp_signed("!=", self.of["is_listed"], word(0))
            is_safe = safety_m.is_at_most(distance)
            unlisted = b.and_(is_listed, b.not_(is_sure))
            self.unless(b.or_(b.not_(is_safe), unlisted), undone)

    def watch(self, now: Ir, short: Ir, arrived: Ir, undone: Ir) -> Ir:
        """Have the watchman look, and say whether somebody goes.

        Where somebody may be blocked Python does, and where nobody goes in a round in which nobody
        has arrived either.
        """
        b = self.b
        moments, place = self.at("moments"), self.by(now, DOUBLE_BYTES)
        for k, name in enumerate(("began", "ended")):
            value = self.code.get(self.at(name), place, F64)
            self.code.put(moments, DOUBLE_BYTES * k, value)
        of = self.of
        given = [of["automata"], short, of["stopped"], self.b.load(self.last)]
        given += [of[name] for name in ("lingering", "lingering_s", "moments", "count")]
        found = self.code.called(of["watch"], given)
        some, none = (b.icmp_signed("==", found, word(one)) for one in (SOMEBODY, NOBODY))
        self.unless(b.not_(b.or_(some, b.and_(none, arrived))), undone)
        return some

    def hear(self) -> Ir:
        """Note who has arrived, as ``Reader.read`` does and ``Columns.measure``; say if any has."""
        code, b = self.code, self.b
        changed = code.slot(I64)
        b.store(word(0), changed)
        with code.loop(word(0), self.of["heard_count"]) as number:
            one = self.at("heard", self.by(number, WORD_BYTES * HEARD_WORDS))
            told, column, columns = code.words(one, HEARD_WORDS)
            told, column = (b.inttoptr(x, BYTES) for x in (told, column))
            with code.loop(word(0), self.count) as robot:
                now, before = (code.get(x, robot, I8) for x in (self.at("reached"), told))
                with code.only_if(b.icmp_signed("!=", now, before)):
                    b.store(word(1), changed)
                    code.put(told, robot, now)
                    with code.only_if(b.icmp_signed("!=", columns, word(0))):
                        code.put(column, self.by(robot, WORD_BYTES), b.zext(now, I64))
        return b.icmp_signed("!=", b.load(changed), word(0))

    def see(self, undone: Ir) -> None:
        """Note where robots are, as ``Reader.read`` does and ``Columns.measure``."""
        code, b, lanes = self.code, self.b, self.lanes
        here = b.inttoptr(b.load(self.last), BYTES)

        def at(robot: Ir) -> list[Lane]:
            place = code.at(here, self.by(robot, _PLACE))
            return [lanes.get(place, DOUBLE_BYTES * axis) for axis in range(3)]

        with code.loop(word(0), self.count) as robot:
            for value in at(robot):
                is_number = value.is_at_most(float("inf"))
                self.unless(b.not_(is_number), undone)
        with code.loop(word(0), self.of["seen_count"]) as number:
            one = self.at("seen", self.by(number, WORD_BYTES * SEEN_WORDS))
            told, late, width, column, columns = code.words(one, SEEN_WORDS)
            told, late, column = (b.inttoptr(x, BYTES) for x in (told, late, column))
            with code.loop(word(0), self.count) as robot:
                known = code.at(told, self.by(robot, _PLACE))
                differs = constant(I8, 0)
                for axis, value in enumerate(at(robot)):
                    old = lanes.get(known, DOUBLE_BYTES * axis)
                    is_other = b.fcmp_unordered("!=", value.ir, old.ir)
                    counts = b.icmp_signed("<", word(axis), width)
                    differs = b.or_(differs, b.zext(b.and_(is_other, counts), I8))
                moved = b.icmp_signed("!=", differs, constant(I8, 0))
                with code.only_if(moved):
                    for axis, value in enumerate(at(robot)):
                        lanes.put(known, DOUBLE_BYTES * axis, value)
                    code.put(late, robot, constant(I8, 1))
                with code.loop(word(0), columns) as axis:
                    row = b.add(self.by(axis, self.count), robot)
                    value = code.get(known, self.by(axis, DOUBLE_BYTES), F64)
                    code.put(column, self.by(row, DOUBLE_BYTES), value)
