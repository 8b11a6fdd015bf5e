"""Machine code that combines the moves of all robots in a state. [ATOMIC] [LOST-UPDATE]"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from koord.kernels.context import LEFT_TOO_MANY, Context
from koord.kernels.module import RoundModule, either
from koord.kernels.moves import MoveWriter, most_moves
from koord.kernels.races import commit, masks_of, move_of
from koord.kernels.terms import NoKernelError
from koord.machine.code import BYTES, I64, Code, Ir, constant, word

#: Robots have so many different moves in one state at most.
_MOST_MOVES = 20_000

#: A state has so many combinations of moves and of environments' turns at most: machine code comes
#: back to Python between states only.
_MOST_SUCCESSORS = 1 << 22


def expand_one_code(
    of: RoundModule, events: Sequence[Sequence[Ir]], middle: Ir, races: Ir, ways: int
) -> Ir:
    """``expand_one(context, state)``: all rounds from a state. ``ways`` are the environments'."""
    code = Code(of.module, "expand_one", (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    b = code.b
    if sum(most_moves(of, i) for i in of.robots) > _MOST_MOVES:
        raise NoKernelError("robots have too many moves in one state")
    writer = MoveWriter(code, of, context, state, events)
    blocks = [code.block(most_moves(of, i) * of.course.size) for i in of.robots]
    counts = [writer.moves(i, blocks[i]) for i in of.robots]
    product = word(ways)
    for count in counts:
        # Each factor is small, and what has grown too large stays so.
        fits = b.icmp_signed("<=", product, word(_MOST_SUCCESSORS))
        product = b.select(fits, b.mul(product, count), product)
    with b.if_then(b.icmp_signed(">", product, word(_MOST_SUCCESSORS))):
        context.leave(LEFT_TOO_MANY)
        b.ret(word(0))
    combiner = _Combiner(code, of, context, state, blocks, counts, middle, races)
    combiner.combine(0, _Partial(of.shared_words))
    b.ret(word(0))
    return code.function


class _Partial:
    """What the moves of some robots come to: lock classes taken, and the store's cells written."""

    def __init__(self, words: int) -> None:
        self.taken: Ir = word(0)
        self.met: Ir = word(0)
        self.covered: list[Ir] = [word(0)] * words
        self.values: list[Ir] = [word(0)] * words


class _Combiner:
    def __init__(
        self,
        code: Code,
        of: RoundModule,
        context: Context,
        state: Ir,
        blocks: Sequence[Ir],
        counts: Sequence[Ir],
        middle: Ir,
        races: Ir,
    ) -> None:
        self._code, self._of, self._context = code, of, context
        self._blocks, self._counts = blocks, counts
        self._middle, self._races = middle, races
        self._after = code.block(of.cells.state_bytes)
        self._moves = code.block(8 * len(of.robots))
        code.copy(self._after, state, of.cells.state_bytes)

    def combine(self, robot: int, before: _Partial) -> None:
        """Combine moves of the robots from one on with those before. [ATOMIC]"""
        code, of = self._code, self._of
        b, course, cells = code.b, of.course, of.cells
        if robot == len(of.robots):
            self._combined(before)
            return
        own = of.layout.robots[robot]
        with code.loop(word(0), self._counts[robot]) as chosen:
            move = code.at(self._blocks[robot], b.mul(chosen, word(course.size)))
            entered = code.get(move, course.entered, I64)
            free = b.icmp_signed("==", b.and_(entered, before.taken), word(0))
            with b.if_then(free):
                code.put(self._moves, 8 * robot, b.ptrtoint(move, I64))
                to = code.at(self._after, own.first * cells.size)
                size = (own.end - own.first) * cells.size
                code.copy(to, code.at(move, course.own), size)
                masks = code.words(code.at(move, course.mask), of.shared_words)
                values = code.words(code.at(move, course.values), of.shared_words)
                met = [b.and_(m, c) for m, c in zip(masks, before.covered, strict=True)]
                now = _Partial(of.shared_words)
                now.taken = b.or_(before.taken, entered)
                now.met = b.or_(before.met, either(code, met))
                now.covered = [b.or_(c, m) for c, m in zip(before.covered, masks, strict=True)]
                now.values = [b.or_(w, v) for w, v in zip(before.values, values, strict=True)]
                self.combine(robot + 1, now)

    def _combined(self, now: _Partial) -> None:
        code, of = self._code, self._of
        b, words = code.b, range(of.shared_words)
        covered, values = (code.block(of.cells.shared_bytes) for _ in range(2))
        with b.if_else(b.icmp_signed("==", now.met, word(0))) as (apart, race):
            with apart:
                for k in words:
                    code.put(covered, 8 * k, now.covered[k])
                    code.put(values, 8 * k, now.values[k])
                commit(code, of, self._context, self._after, (covered, values), self._middle)
            with race:
                self._note_lost()
                for k in words:
                    code.put(covered, 8 * k, word(0))
                    code.put(values, 8 * k, word(0))
                everybody = word((1 << len(of.robots)) - 1)
                address = self._context.address
                arguments = [address, self._after, self._moves, everybody, covered, values]
                b.call(self._races, arguments)

    def _note_lost(self) -> None:
        """Note lost updates: one's update meets another's write. [LOST-UPDATE]"""
        code, of = self._code, self._of
        b = code.b
        if not of.goals.lost:
            return
        lost: list[Ir] = [word(0)] * of.shared_words
        for i in of.robots:
            move = code.at(move_of(code, self._moves, i), of.course.updates)
            mine = code.words(move, of.shared_words)
            for j in of.robots:
                if i != j:
                    masks = masks_of(code, of, self._moves, j)
                    lost = [
                        b.or_(x, b.and_(m, o)) for x, m, o in zip(lost, mine, masks, strict=True)
                    ]
        block = code.block(of.cells.shared_bytes)
        for k, part in enumerate(lost):
            code.put(block, 8 * k, part)
        size, first, type_ = of.cells.size, of.layout.shared_first, of.cells.type
        for position, slot in enumerate(of.goals.lost):
            for cell in _cells_of(of.layout.allwrite[slot]):
                held = code.get(block, (cell - first) * size, type_)
                with b.if_then(b.icmp_signed("!=", held, constant(type_, 0))):
                    self._context.find(of.goals.fault + 1 + position, self._context.behind())


def _cells_of(atoms: Any) -> list[int]:
    if isinstance(atoms, tuple):
        return [cell for part in atoms for cell in _cells_of(part)]
    return [atoms.value]
