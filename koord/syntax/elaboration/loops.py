"""Elaboration of loops. Bounds are constants, ids, numbers of robots, lengths, outer loops."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope, LoopScope
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.literals import gone_through
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.resolve_types import element_of
from koord.syntax.elaboration.symbols import Role
from koord.syntax.types import INT, MapType, Type

_BOUND_OPS = frozenset(
    {
        core.BinaryOp.ADD,
        core.BinaryOp.SUB,
        core.BinaryOp.MUL,
        core.BinaryOp.DIV,
        core.BinaryOp.MOD,
        core.BinaryOp.MIN,
        core.BinaryOp.MAX,
    }
)


def for_range(body: BodyScope, s: ast.ForRange) -> core.Block:
    """Elaborate ``for i = low, high:``."""
    low = _bound(body, s.low, "the start of a loop")
    high = _bound(body, s.high, "the end of a loop")
    body.loops.append(_loop_over(body, s))
    body.session.loop_variables.add(s.variable.name)
    with body.frame():
        symbol = body.declare(s.variable, INT, Role.LOOP)
        if symbol.variable is not None:
            body.counters.add(symbol.variable)
        inner = _inside(body, s.body)
    body.loops.pop()
    if low is None or high is None or symbol.variable is None:
        return ()
    return (core.ForRange(symbol.variable, low, high, inner, span=s.span),)


def repeat(body: BodyScope, s: ast.Repeat) -> core.Block:
    """Elaborate ``repeat n:``, a loop from 0 to ``n`` with a hidden variable. [S-FOR]"""
    count = _bound(body, s.count, "how often a loop repeats")
    with body.frame():
        variable = body.slot("trip", INT)
        inner = _inside(body, s.body)
    if count is None:
        return ()
    return (core.ForRange(variable, core.Const(0, INT, span=s.span), count, inner, span=s.span),)


def _inside(body: BodyScope, statements: ast.Block) -> core.Block:
    body.breakable += 1
    inner = body.block(statements)
    body.breakable -= 1
    return inner


def _bound(body: BodyScope, e: ast.Expr, what: str) -> core.Expr | None:
    bound = fit(body, body.expr(e, INT), INT, e.span, what)
    if bound is None or _known_beforehand(body, bound):
        return bound
    body.error(
        "K215",
        e.span,
        f"{what} is known beforehand: a constant, `pid`, `numAgents`, the `length` of a list, or "
        "the number that a loop around it is at",
        "loop over a range that is large enough, and test or `break` inside",
    )
    return None


def _known_beforehand(body: BodyScope, bound: core.Expr) -> bool:
    match bound:
        case core.Const() | core.Pid() | core.NumAgents():
            return True
        case core.Builtin(op=core.ListOp.LENGTH):
            return True
        case core.Read(place=core.Place(variable=variable, steps=())):
            return variable in body.counters
        case core.Unary(operand=operand):
            return _known_beforehand(body, operand)
        case core.Binary(op=op, left=left, right=right):
            return op in _BOUND_OPS and all(_known_beforehand(body, e) for e in (left, right))
        case _:
            return False


def _loop_over(body: BodyScope, s: ast.ForRange) -> LoopScope:
    """The list whose positions the loop visits, if its end is a length; for hints."""
    match s.high:
        case ast.Call(function=ast.Ident(name="length" | "len"), arguments=(argument,)):
            over: ast.Expr | None = argument.value
        case ast.MethodCall(receiver=receiver, method=ast.Ident(name="length" | "len")):
            over = receiver
        case _:
            over = None
    element = _variable_element(body, over) if isinstance(over, ast.Name) else None
    return LoopScope(s.variable.name, over, element, by_position=True)


def _variable_element(body: BodyScope, over: ast.Name) -> Type | None:
    found = body.lookup(over.name)
    variable = found.variable if found is not None else None
    if variable is None:
        known = body.session.shared.get(over.name)
        if known is None and body.agent is not None:
            known = body.agent.variables.get(over.name)
        variable = getattr(known, "variable", None)
    return element_of(variable.type) if isinstance(variable, core.Variable) else None


def for_each(body: BodyScope, s: ast.ForEach) -> core.Block:
    """Elaborate ``for x in list:`` and ``for k, v in list:``."""
    sequence = gone_through(body, s.sequence)
    key_type, value_type = _visited(body, s, sequence)
    body.loops.append(LoopScope(s.variables[-1].name, s.sequence, value_type, by_position=False))
    with body.frame():
        key = body.declare(s.variables[0], key_type, Role.LOOP) if len(s.variables) > 1 else None
        if key and key.variable and sequence and not isinstance(sequence.type, MapType):
            body.counters.add(key.variable)
        value = body.declare(s.variables[-1], value_type, Role.ELEMENT)
        inner = _inside(body, s.body)
    body.loops.pop()
    if sequence is None or value.variable is None:
        return ()
    if key is None:
        return (core.ForEach(None, value.variable, sequence, inner, span=s.span),)
    if key.variable is None:
        return ()
    return (core.ForEach(key.variable, value.variable, sequence, inner, span=s.span),)


def _visited(
    body: BodyScope, s: ast.ForEach, sequence: core.Expr | None
) -> tuple[Type | None, Type | None]:
    if sequence is None:
        return (INT, None)
    if isinstance(sequence.type, MapType):
        if len(s.variables) == 1:
            name = s.variables[0].name
            body.error(
                "K229",
                s.variables[0].span,
                "a loop through a map has two variables, for key and value",
                f"write `for key, {name} in …:`",
            )
            return (None, None)
        return (sequence.type.key, sequence.type.value)
    element = element_of(sequence.type)
    if element is None:
        body.error(
            "K229",
            s.sequence.span,
            f"{a(sequence.type)} has no elements to go through",
            "a loop over numbers is written `for i = 0, n:`" if sequence.type == INT else None,
        )
    return (INT, element)


def break_(body: BodyScope, s: ast.Break) -> core.Block:
    """Elaborate ``break``."""
    if body.breakable:
        return (core.Break(span=s.span),)
    body.error("K220", s.span, "`break` stands in loops only")
    return ()
