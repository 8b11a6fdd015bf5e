"""Machine code of writers that meet: every end of the store, and the commit. [T-ONE-WINNER]
[T-COMMIT]
"""

from __future__ import annotations

from koord.kernels.context import Context
from koord.kernels.module import RoundModule, either
from koord.machine.code import BYTES, I1, I64, Code, Ir, word


def races_code(of: RoundModule, middle: Ir) -> Ir:
    """``races(context, state, moves, waiting, covered, values)``: every end of a race.

    ``moves`` are the addresses of the robots' courses. Writers are tried from the last to the
    first: of the last one all is seen, of one before what the later ones leave open. A writer
    that is hidden by later ones is left out, and one that meets no other needs no order.
    """
    code = Code(of.module, "races", (BYTES, BYTES, BYTES, I64, BYTES, BYTES), I64)
    address, state, moves, waiting, covered, values = code.arguments
    context = Context(code, address)
    b, size = code.b, of.cells.shared_bytes
    mine, written = code.block(size), code.block(size)
    code.copy(mine, covered, size)
    code.copy(written, values, size)
    covered_words = code.words(covered, of.shared_words)
    seen = [
        [
            b.and_(m, b.not_(c))
            for m, c in zip(masks_of(code, of, moves, i), covered_words, strict=True)
        ]
        for i in of.robots
    ]
    open_ = [
        b.and_(
            b.trunc(b.lshr(waiting, word(i)), I1),
            b.icmp_signed("!=", either(code, seen[i]), word(0)),
        )
        for i in of.robots
    ]
    left = code.slot(I64)
    b.store(word(0), left)
    for i in of.robots:
        met = word(0)
        for j in of.robots:
            if j != i:
                both = [b.and_(x, y) for x, y in zip(seen[i], seen[j], strict=True)]
                met = b.or_(met, b.select(open_[j], either(code, both), word(0)))
        meets = b.icmp_signed("!=", met, word(0))
        with b.if_then(b.and_(open_[i], b.not_(meets))):
            _apply(code, of, moves, i, mine, written)
        bit = b.select(b.and_(open_[i], meets), word(1 << i), word(0))
        b.store(b.or_(b.load(left), bit), left)
    rest = b.load(left)
    with b.if_else(b.icmp_signed("==", rest, word(0))) as (done, more):
        with done:
            commit(code, of, context, state, (mine, written), middle)
        with more:
            next_mask, next_values = code.block(size), code.block(size)
            for i in of.robots:
                with b.if_then(b.trunc(b.lshr(rest, word(i)), I1)):
                    code.copy(next_mask, mine, size)
                    code.copy(next_values, written, size)
                    _apply(code, of, moves, i, next_mask, next_values)
                    others = b.and_(rest, word(~(1 << i)))
                    b.call(code.function, [address, state, moves, others, next_mask, next_values])
    b.ret(word(0))
    return code.function


def move_of(code: Code, moves: Ir, robot: int) -> Ir:
    """The course of a robot, whose address is among some."""
    return code.b.inttoptr(code.get(moves, 8 * robot, I64), BYTES)


def masks_of(code: Code, of: RoundModule, moves: Ir, robot: int) -> list[Ir]:
    """What a robot's course writes of the store."""
    return code.words(code.at(move_of(code, moves, robot), of.course.mask), of.shared_words)


def _apply(code: Code, of: RoundModule, moves: Ir, robot: int, covered: Ir, values: Ir) -> None:
    """Let a writer write what nobody behind it has written."""
    b, move = code.b, move_of(code, moves, robot)
    for k in range(of.shared_words):
        before = code.get(covered, 8 * k, I64)
        mask = code.get(move, of.course.mask + 8 * k, I64)
        its = b.and_(code.get(move, of.course.values + 8 * k, I64), b.not_(before))
        code.put(values, 8 * k, b.or_(code.get(values, 8 * k, I64), its))
        code.put(covered, 8 * k, b.or_(before, mask))


def commit(
    code: Code, of: RoundModule, context: Context, state: Ir, written: tuple[Ir, Ir], middle: Ir
) -> None:
    """The store after all writes, ``written`` where and what; ``state`` has the robots already."""
    covered, values = written
    b, after, cells = code.b, code.block(of.cells.state_bytes), of.cells
    shared, first = cells.shared_cells * cells.size, of.layout.shared_first * cells.size
    code.copy(after, state, cells.state_bytes)
    merged = code.block(cells.shared_bytes)
    for k in range(of.shared_words):
        code.put(merged, 8 * k, word(0))
    code.copy(merged, code.at(state, first), shared)
    for k in range(of.shared_words):
        old = b.and_(code.get(merged, 8 * k, I64), b.not_(code.get(covered, 8 * k, I64)))
        code.put(merged, 8 * k, b.or_(old, code.get(values, 8 * k, I64)))
    code.copy(code.at(after, first), merged, shared)
    b.call(middle, [context.address, after])
