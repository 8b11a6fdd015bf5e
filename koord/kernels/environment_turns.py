"""Machine code of the environment's turns of all robots. [ENV-TRANS]"""

from __future__ import annotations

from collections.abc import Sequence

from koord.kernels.context import LEFT_TOO_LARGE, Context
from koord.kernels.module import RoundModule, is_too_large, outcome
from koord.kernels.terms import NoKernelError, Scalar, Term
from koord.kernels.turn_code import FAULTS, POSSIBLE
from koord.kernels.turns import TurnTerms
from koord.machine.code import BYTES, I1, I64, Code, Ir, constant, word

#: All robots' environments together have so many ways to take their turns at most.
_MOST_WAYS = 1 << 22


def ways_of(environments: Sequence[TurnTerms | None]) -> int:
    """The ways of all environments to take their turns. Raises NoKernelError if there are too many.

    Machine code comes back to Python between states only, so one state must not take long.
    """
    product = 1
    for turn in environments:
        product *= turn.combinations if turn is not None else 1
    if product > _MOST_WAYS:
        raise NoKernelError(f"the environment has {product} ways to take its turns")
    return product


def idle_cells(environments: Sequence[TurnTerms | None]) -> frozenset[int]:
    """The cells that environments' turns overwrite and do not read."""
    written, read = set(), set()
    for turn in environments:
        if turn is None:
            continue
        written |= {cell for cell, _ in turn.after}
        read |= cells_read((turn.possible, turn.faults, *(value for _, value in turn.after)))
    return frozenset(written - read)


def cells_read(scalars: Sequence[Scalar]) -> set[int]:
    """The cells that some terms read."""
    seen: set[int] = set()
    found: set[int] = set()
    waiting = [scalar for scalar in scalars if isinstance(scalar, Term)]
    while waiting:
        term = waiting.pop()
        if id(term) in seen:
            continue
        seen.add(id(term))
        if term.op == "cell":
            found.add(term.number)
        waiting += [a for a in term.args if isinstance(a, Term)]
    return found


def environment_turns_code(of: RoundModule, turns: Sequence[Ir | None], enter: Ir) -> Ir:
    """``environment(context, state)``: enter all that the environment makes of a middle.

    ``turns`` are the functions of single robots' turns.
    """
    code = Code(of.module, "environment", (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    size = of.cells.state_bytes
    after = code.block(size)
    code.copy(after, state, size)
    if of.goals.faults and any(e is not None and e.faults is not False for e in of.environments):
        _note_faults(code, of, turns, context, state, after)
        code.copy(after, state, size)
    _take_turns(code, of, turns, enter, context, (state, after), 0)
    code.b.ret(word(0))
    return code.function


def _note_faults(
    code: Code, of: RoundModule, turns: Sequence[Ir | None], context: Context, state: Ir, after: Ir
) -> None:
    """Note a fault of a model, if every robot's environment has a turn."""
    b = code.b
    all_have: Ir = constant(I1, 1)
    any_faults: Ir = constant(I1, 0)
    for turn, function in zip(of.environments, turns, strict=True):
        if turn is None:
            continue
        seen = code.slot(I64)
        b.store(word(0), seen)
        with code.loop(word(0), word(turn.combinations)) as chosen:
            flags = b.call(function, [state, chosen, after])
            possible = b.icmp_signed("!=", b.and_(flags, word(POSSIBLE)), word(0))
            b.store(b.or_(b.load(seen), b.select(possible, flags, word(0))), seen)
        has = b.icmp_signed("!=", b.load(seen), word(0))
        faults = b.icmp_signed("!=", b.and_(b.load(seen), word(FAULTS)), word(0))
        all_have, any_faults = b.and_(all_have, has), b.or_(any_faults, faults)
    with b.if_then(b.and_(all_have, any_faults)):
        context.find(of.goals.fault, context.behind())


def _take_turns(
    code: Code,
    of: RoundModule,
    turns: Sequence[Ir | None],
    enter: Ir,
    context: Context,
    held: tuple[Ir, Ir],
    robot: int,
) -> None:
    state, after = held
    if robot == len(of.environments):
        code.b.call(enter, [context.address, after])
        return
    turn = of.environments[robot]
    if turn is None:
        _take_turns(code, of, turns, enter, context, held, robot + 1)
        return
    with code.loop(word(0), word(turn.combinations)) as chosen:
        flags = code.b.call(turns[robot], [state, chosen, after])
        with code.b.if_then(outcome(code, flags, 0)):
            with code.b.if_then(is_too_large(code, flags)):
                context.leave(LEFT_TOO_LARGE)
            _take_turns(code, of, turns, enter, context, held, robot + 1)
