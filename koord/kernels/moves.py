"""Machine code of the different moves that each robot has in a state. [SKIP] [SELECT]"""

from __future__ import annotations

from collections.abc import Sequence

from koord.kernels.context import LEFT_TOO_LARGE, Context
from koord.kernels.module import RoundModule, either, is_too_large, outcome
from koord.kernels.turn_code import FAULTS, FLAGS
from koord.machine.code import I64, Code, Ir, word
from koord.semantics.configurations import NO_EVENT
from koord.syntax.system import Status


def most_moves(of: RoundModule, robot: int) -> int:
    """A robot has so many moves in a state at most."""
    return 1 + sum(turn.combinations for turn in of.events[robot])


class MoveWriter:
    """A writer of the code that puts one robot's courses into a block."""

    def __init__(
        self,
        code: Code,
        of: RoundModule,
        context: Context,
        state: Ir,
        events: Sequence[Sequence[Ir]],
    ) -> None:
        self._code = code
        self._of = of
        self._context = context
        self._state = state
        self._events = events

    def moves(self, robot: int, block: Ir) -> Ir:
        """Put a robot's different moves into a block; how many there are."""
        code, of = self._code, self._of
        b, course, cells = code.b, of.course, of.cells
        count, own = code.slot(I64), of.layout.robots[robot]
        for offset in range(0, course.size, 8):
            code.put(block, offset, word(0))
        source = code.at(self._state, own.first * cells.size)
        code.copy(code.at(block, course.own), source, (own.end - own.first) * cells.size)
        if own.ran is not None:
            nothing = cells.narrow(code, word(NO_EVENT))
            code.put(block, course.own + (own.ran - own.first) * cells.size, nothing)
        b.store(word(1), count)
        if own.status is None:
            self._run_events(robot, block, count)
            return b.load(count)
        status = cells.read(code, self._state, own.status)
        with b.if_then(b.icmp_signed("!=", status, word(int(Status.STOPPED)))):
            self._run_events(robot, block, count)
        return b.load(count)

    def _run_events(self, robot: int, block: Ir, count: Ir) -> None:
        for position, turn in enumerate(self._of.events[robot]):
            if turn.possible is not False:
                self._run(robot, position, block, count)

    def _run(self, robot: int, position: int, block: Ir, count: Ir) -> None:
        """Run one event with all choices that matter, and keep courses that are new."""
        code, of, turn = self._code, self._of, self._of.events[robot][position]
        b, course, size, next_ = code.b, of.course, of.course.size, code.slot(I64)
        b.store(word(0), next_)
        with code.while_(lambda: b.icmp_signed("<", b.load(next_), word(turn.combinations))):
            chosen = b.load(next_)
            place = code.at(block, b.mul(b.load(count), word(size)))
            for offset in range(course.own, course.values, 8):
                # What is left over behind a robot's cells would tell equal moves apart.
                code.put(place, offset, word(0))
            flags = b.call(self._events[robot][position], [self._state, chosen, place])
            b.store(b.add(chosen, b.lshr(flags, word(FLAGS))), next_)
            if of.goals.faults and turn.faults is not False:
                with b.if_then(outcome(code, flags, FAULTS)):
                    self._context.find(of.goals.fault, self._context.behind())
            with b.if_then(outcome(code, flags, 0)):
                with b.if_then(is_too_large(code, flags)):
                    self._context.leave(LEFT_TOO_LARGE)
                is_new = code.slot(I64)
                b.store(word(1), is_new)
                mine = code.words(place, size // 8)
                with code.loop(word(0), b.load(count)) as other:
                    theirs = code.words(code.at(block, b.mul(other, word(size))), size // 8)
                    parts = [b.xor(x, y) for x, y in zip(mine, theirs, strict=True)]
                    with b.if_then(b.icmp_signed("==", either(code, parts), word(0))):
                        b.store(word(0), is_new)
                b.store(b.add(b.load(count), b.load(is_new)), count)
