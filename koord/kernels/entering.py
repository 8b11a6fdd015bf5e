"""Machine code that enters states into the table and looks at the new ones. [SYMMETRY] [CONFIG]

Nearly all states that rounds lead to are known already, and to know that takes two looks into
memory that is far away. So states wait until there are many: then what stands at the first place of
each is fetched, without waiting in between, and those that stand there are done with.
"""

from __future__ import annotations

from collections.abc import Sequence

from koord.kernels.context import (
    BEFORE,
    CURRENT,
    STATES,
    TABLE,
    TABLE_MASK,
    WAITING,
    WAITING_COUNT,
    WORK,
    Context,
)
from koord.kernels.module import RoundModule
from koord.machine.code import BYTES, I8, I32, I64, Code, Ir, constant, word

#: So many states wait at most.
MOST_WAITING = 128


def renamed(code: Code, of: RoundModule, canonical: Ir, state: Ir) -> Ir:
    """What stands for a state. ``canonical`` is the function that renames robots."""
    if of.layout.symmetry is None:
        return state
    out, names = code.block(of.cells.state_bytes), code.block(8 * of.layout.names)
    code.b.call(canonical, [state, out, names])
    return out


def enter_code(of: RoundModule, canonical: Ir, insert: Ir, statements: Sequence[Ir]) -> Ir:
    """``enter(context, state)``: put a state into the table, and look at it if it is new.

    It gives the state's number, or -1 if it was there.
    """
    code = Code(of.module, "enter", (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    b = code.b
    kept = renamed(code, of, canonical, state)
    number = b.call(insert, [context.address, kept])
    with b.if_then(b.icmp_signed(">=", number, word(0))):
        _look(code, of, context, kept, number, statements)
    b.ret(number)
    return code.function


def _look(
    code: Code, of: RoundModule, context: Context, kept: Ir, number: Ir, statements: Sequence[Ir]
) -> None:
    b = code.b
    current = b.trunc(context.get(CURRENT), I32)
    code.put(context.block(BEFORE), b.shl(number, word(2)), current)
    for goal, holds in enumerate(statements):
        with b.if_then(b.not_(b.call(holds, [kept]))):
            context.find(goal, b.shl(number, word(1)))


def settle_code(of: RoundModule, hashed: Ir, insert: Ir, statements: Sequence[Ir]) -> Ir:
    """``settle(context)``: enter all states that wait, in the order in which they came."""
    code = Code(of.module, "settle", (BYTES,), I64)
    context = Context(code, code.arguments[0])
    b, size, words = code.b, of.cells.state_bytes, of.cells.state_bytes // 8
    waiting, count = context.block(WAITING), context.get(WAITING_COUNT)
    numbers, known = code.block(4 * MOST_WAITING), code.block(MOST_WAITING)
    table, mask, states = context.block(TABLE), context.get(TABLE_MASK), context.block(STATES)
    with code.loop(word(0), count) as k:
        place = b.and_(b.call(hashed, [code.at(waiting, b.mul(k, word(size)))]), mask)
        code.put(numbers, b.shl(k, word(2)), code.get(table, b.shl(place, word(2)), I32))
    with code.loop(word(0), count) as k:
        entry = b.zext(code.get(numbers, b.shl(k, word(2)), I32), I64)
        is_taken = b.icmp_signed("!=", entry, word(0))
        # Where nothing stands the first state is read, and is not believed.
        number = b.select(is_taken, b.sub(entry, word(1)), word(0))
        mine = code.words(code.at(waiting, b.mul(k, word(size))), words)
        theirs = code.words(code.at(states, b.mul(number, word(size))), words)
        differs = word(0)
        for one, other in zip(mine, theirs, strict=True):
            differs = b.or_(differs, b.xor(one, other))
        same = b.and_(is_taken, b.icmp_signed("==", differs, word(0)))
        code.put(known, k, b.zext(same, I8))
    with code.loop(word(0), count) as k:
        is_open = b.icmp_signed("==", code.get(known, k, I8), constant(I8, 0))
        with b.if_then(is_open):
            state = code.at(waiting, b.mul(k, word(size)))
            number = b.call(insert, [context.address, state])
            with b.if_then(b.icmp_signed(">=", number, word(0))):
                _look(code, of, context, state, number, statements)
    context.put(WAITING_COUNT, word(0))
    b.ret(word(0))
    return code.function


def await_code(of: RoundModule, canonical: Ir, settle: Ir) -> Ir:
    """``await(context, state)``: let what stands for a state wait to be entered."""
    code = Code(of.module, "await", (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    b, size = code.b, of.cells.state_bytes
    context.add(WORK, word(1))
    count = context.get(WAITING_COUNT)
    place = code.at(context.block(WAITING), b.mul(count, word(size)))
    code.copy(place, renamed(code, of, canonical, state), size)
    after = b.add(count, word(1))
    context.put(WAITING_COUNT, after)
    with b.if_then(b.icmp_signed("==", after, word(MOST_WAITING))):
        b.call(settle, [context.address])
    b.ret(word(0))
    return code.function
