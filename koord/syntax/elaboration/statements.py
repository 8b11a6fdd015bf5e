"""Elaboration of statements."""

from __future__ import annotations

from fractions import Fraction
from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration import loops
from koord.syntax.elaboration.body import MAX_DEPTH, AtomicBlock, BodyScope, Where
from koord.syntax.elaboration.changes import call_statement, place_shown, pop_into, target
from koord.syntax.elaboration.coercion import POISON, fit, stores_list
from koord.syntax.elaboration.operators import pieces
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.places import find_module, meaning
from koord.syntax.elaboration.recorder import ModuleSymbol, OwnName
from koord.syntax.elaboration.resolve_types import is_numeric, resolve
from koord.syntax.elaboration.symbols import PortSymbol, Role, StreamSymbol
from koord.syntax.types import BOOL, FLOAT, INT, STREAM

_PROGRAM = frozenset({Where.EFFECT, Where.INIT})
#: Where a body has variables of its own, gone when it ends.
_OWN_VARIABLES = frozenset({Where.FUNCTION, Where.ENVIRONMENT})


def block(body: BodyScope, statements: ast.Block) -> core.Block:
    """Elaborate statements in order; wrong ones are reported and left out."""
    if body.depth >= MAX_DEPTH:
        body.error(
            "K231",
            statements[0].span,
            f"this is nested more than {MAX_DEPTH} deep",
            "make a function of the inner ones",
        )
        return ()
    body.depth += 1
    result: list[core.Stmt] = []
    for s in statements:
        match s:
            case ast.Assign():
                made = assign(body, s)
            case ast.If():
                made = if_(body, s)
            case ast.ForRange():
                made = loops.for_range(body, s)
            case ast.ForEach():
                made = loops.for_each(body, s)
            case ast.Repeat():
                made = loops.repeat(body, s)
            case ast.CallStmt():
                made = call_statement(body, s)
            case ast.Increment():
                made = increment(body, s)
            case ast.Atomic():
                made = _atomic(body, s)
            case ast.Break():
                made = loops.break_(body, s)
            case ast.Return():
                made = _return(body, s)
            case ast.Stop() | ast.TryStop():
                made = _stop(body, s)
            case ast.Output():
                made = output(body, s)
            case ast.LocalDecl():
                made = _local(body, s)
            case ast.Pass():
                made = ()
            case _:
                assert_never(s)
        result.extend(made)
    body.depth -= 1
    return tuple(result)


def if_(body: BodyScope, s: ast.If) -> core.Block:
    """Elaborate ``if … elif … else`` as nested two-way choices."""
    if len(s.arms) + body.depth > MAX_DEPTH:
        body.error(
            "K231",
            s.arms[MAX_DEPTH - body.depth][0].span,
            f"this is nested more than {MAX_DEPTH} deep: an `elif` is an `if` in the `else` before",
        )
        return ()
    arms: list[tuple[core.Expr | None, core.Block]] = []
    for condition, then in s.arms:
        tested = fit(
            body, body.expr(condition, BOOL), BOOL, condition.span, "the condition of `if`"
        )
        arms.append((tested, body.block(then)))
    otherwise = body.block(s.otherwise) if s.otherwise is not None else ()
    for tested, inner in reversed(arms):
        if tested is None:
            return ()
        otherwise = (core.If(tested, inner, otherwise, span=s.span),)
    return otherwise


def _atomic(body: BodyScope, s: ast.Atomic) -> core.Block:
    if body.where is not Where.EFFECT:
        body.error(
            "K225",
            s.span,
            f"`atomic` has no place in {body.where.value}",
            "it keeps the events of robots apart; only effects need it",
        )
        body.block(s.body)
        return ()
    if body.atomic is not None:
        body.error(
            "K214",
            s.span,
            "`atomic` stands inside `atomic`",
            "the outer one locks the whole effect already: leave this one out",
        )
        return body.block(s.body)
    blocks = body.session.atomic_blocks
    body.atomic = blocks.setdefault(id(s), AtomicBlock(len(blocks)))
    inner = body.block(s.body)
    made = core.Atomic(body.atomic.number, inner, span=s.span)
    body.atomic = None
    return (made,)


def _return(body: BodyScope, s: ast.Return) -> core.Block:
    if body.where is not Where.FUNCTION:
        body.error(
            "K221",
            s.span,
            "`return` stands in functions only",
            "to end an effect early, put the rest under `else:`",
        )
        return ()
    if s.value is None:
        if body.result is not None:
            body.error("K222", s.span, "this function returns a value: say which")
        return (core.Return(None, span=s.span),)
    value = body.expr(s.value, body.result)
    if body.returned is not None:
        body.returned.append(None if value is None else value.type)
        return ()
    if body.result is None:
        if value is not None:
            body.error(
                "K222",
                s.value.span,
                "this function has no result",
                "declare its type: `def fun f(…) -> int:`",
            )
        return ()
    value = fit(body, value, body.result, s.value.span, "the result")
    return () if value is None else (core.Return(value, span=s.span),)


def _stop(body: BodyScope, s: ast.Stop | ast.TryStop) -> core.Block:
    word = "stop" if isinstance(s, ast.Stop) else "trystop"
    if body.where not in _PROGRAM:
        body.error("K225", s.span, f"`{word}` has no place in {body.where.value}")
        return ()
    return (core.Stop(span=s.span) if isinstance(s, ast.Stop) else core.TryStop(span=s.span),)


def _local(body: BodyScope, s: ast.LocalDecl) -> core.Block:
    decl = s.decl
    if body.where not in _OWN_VARIABLES:
        body.error(
            "K223",
            s.span,
            f"variables are not declared in {body.where.value}",
            f"declare `{decl.name.name}` under `local:`",
        )
        # what follows may use it
        body.declare(decl.name, None, Role.LOCAL)
        return ()
    constants = BodyScope(body.session, Where.CONSTANT, None, body.findings)
    type_ = resolve(constants, decl.type)
    if type_ == STREAM:
        body.error("K238", decl.span, "a stream is a port of a module, not a variable")
        type_ = None
    value = None
    if decl.initial is not None:
        what = f"`{decl.name.name}`"
        value = fit(body, body.expr(decl.initial, type_), type_, decl.initial.span, what)
    known = body.lookup(decl.name.name)
    if known is not None:
        body.error("K208", decl.name.span, f"`{decl.name.name}` is {known.role.value} already")
    symbol = body.declare(decl.name, type_, Role.LOCAL)
    if symbol.variable is None or value is None:
        return ()
    place = core.Place(symbol.variable, span=decl.name.span)
    return (core.Assign(place, value, span=s.span),)


def assign(body: BodyScope, s: ast.Assign) -> core.Block:
    """Elaborate ``target = value``."""
    value = s.value
    if body.where is Where.INIT and _is_sensor(body, s.target):
        _start_of_sensor(body, s)
        return ()
    if isinstance(value, ast.Call | ast.MethodCall):
        name = _called(value)
        if name == "pop" and "pop" not in body.session.functions.own:
            return pop_into(body, s)
        own = name in body.session.functions.own
        if name in ("append", "remove") and not own and _same(_changed(value), s.target):
            # the functional spelling, x = append(x, v)
            return call_statement(body, ast.CallStmt(value, span=s.span))
    place = target(body, s.target)
    found = body.expr(value, place.type if place is not None else POISON)
    if place is None or found is None:
        return ()
    if stores_list(body, place, found, s.target.span.to(s.value.span)):
        return ()
    fitted = fit(body, found, place.type, value.span, place_shown(place, s.target))
    return () if fitted is None else (core.Assign(place, fitted, span=s.span),)


def _is_sensor(body: BodyScope, e: ast.Expr) -> bool:
    assert body.agent is not None
    match e:
        case ast.Name(name=name) if name not in body.agent.variables:
            ports = body.agent.ports.get(name, [])
        case ast.Attribute(base=ast.Name(name=owner), name=ast.Ident(name=name)):
            module = find_module(body, owner)
            ports = [module.ports[name]] if module is not None and name in module.ports else []
        case _:
            return False
    return any(isinstance(p, PortSymbol) and p.direction is core.Direction.SENSOR for p in ports)


def _start_of_sensor(body: BodyScope, s: ast.Assign) -> None:
    """Report a sensor that ``init:`` sets: where it starts is assumed. [OLD-START]"""
    body.expr(s.value, POISON)
    assert isinstance(s.target, ast.Name | ast.Attribute)
    sensor = s.target.name if isinstance(s.target, ast.Name) else s.target.name.name
    if isinstance(s.target, ast.Attribute) and isinstance(s.target.base, ast.Name):
        sensor = f"{s.target.base.name}.{sensor}"
    bounds = s.value.items if isinstance(s.value, ast.ListLit) else (s.value,)
    values = [text for text in map(_number, bounds) if text is not None]
    hint, edits = "say in an assumption where it starts: `assume: …`", tuple[Edit, ...]()
    if len(values) == len(bounds) and len(bounds) in (1, 2):
        low, *high = values
        assumed = f"{low} <= {sensor} and {sensor} <= {high[0]}" if high else f"{sensor} == {low}"
        hint = f"say where it starts: `assume: {assumed}`"
        edits = (Edit(s.span, "pass"), body.session.added(f"assume: {assumed}\n"))
    message = f"`{sensor}` is a sensor: programs read it only"
    body.findings.error("K213", s.target.span, message, hint, (), edits)


def _number(e: ast.Expr) -> str | None:
    """The text of a number or truth value; None for what is no constant."""
    match e:
        case ast.IntLit(value=number):
            return str(number)
        case ast.FloatLit(value=number):
            return repr(float(number))
        case ast.BoolLit(value=truth):
            return "true" if truth else "false"
        case ast.Unary(op=ast.UnaryOp.NEG, operand=operand):
            text = _number(operand)
            return None if text is None else f"-{text}"
        case _:
            return None


def _called(value: ast.Call | ast.MethodCall) -> str:
    return value.function.name if isinstance(value, ast.Call) else value.method.name


def _changed(value: ast.Call | ast.MethodCall) -> ast.Expr | None:
    if isinstance(value, ast.MethodCall):
        return value.receiver
    return value.arguments[0].value if value.arguments else None


def _same(one: ast.Expr | None, other: ast.Expr) -> bool:
    try:
        return one == other
    except RecursionError:  # trees that are refused for their depth later
        return False


def increment(body: BodyScope, s: ast.Increment) -> core.Block:
    """Elaborate ``x++`` and ``x--``."""
    place = target(body, s.target)
    if place is None:
        return ()
    old = meaning(body, s.target)  # once more, as what is read
    if not isinstance(old, core.Place):
        return ()
    if not is_numeric(place.type):
        sign = "++" if s.amount > 0 else "--"
        body.error("K229", s.span, f"`{sign}` applies to numbers, not to {a(place.type)}")
        return ()
    one = (
        core.Const(abs(s.amount), INT, span=s.span)
        if place.type == INT
        else core.Const(Fraction(abs(s.amount)), FLOAT, span=s.span)
    )
    op = core.BinaryOp.ADD if s.amount > 0 else core.BinaryOp.SUB
    read = core.Read(old, span=s.target.span)
    return (core.Assign(place, core.Binary(op, read, one, place.type, span=s.span), span=s.span),)


#: The stream that every program has; `using Log` declares it too.
STDOUT = "stdout"


def output(body: BodyScope, s: ast.Output) -> core.Block:
    """Elaborate a write of values to a stream."""
    values = [piece for value in s.values for piece in pieces(body, value)]
    if body.where not in (Where.EFFECT, Where.INIT):
        body.error(
            "K225", s.span, f"output has no place in {body.where.value}", "only robots write output"
        )
        return ()
    stream = _stream(body, s.stream)
    found = [value for value in values if value is not None]
    if stream is None or len(found) < len(values):
        return ()
    for value in found:
        if value.type == STREAM:
            body.error("K238", value.span, "a stream cannot be written to a stream")
            return ()
    return (core.Output(stream, tuple(found), span=s.span),)


def _stream(body: BodyScope, e: ast.Expr) -> str | None:
    agent = body.agent
    assert agent is not None
    match e:
        case ast.Name(name=name):
            ports = [p for p in agent.ports.get(name, []) if isinstance(p, StreamSymbol)]
            if ports:
                body.note(e.span, ports[0])
                return ports[0].stream
            if name == STDOUT and name not in agent.variables:
                body.note(e.span, OwnName(STDOUT))
                return STDOUT
        case ast.Attribute(base=ast.Name(name=owner), name=ast.Ident(name=port)):
            module = find_module(body, owner)
            found = module.ports.get(port) if module is not None else None
            if isinstance(found, StreamSymbol):
                body.note(e.base.span, ModuleSymbol(owner))
                body.note(e.name.span, found)
                return found.stream
    before = body.findings.errors
    if body.expr(e) is None and body.findings.errors > before:
        return None
    body.error(
        "K238",
        e.span,
        "this is not a stream",
        f"write to `{STDOUT}`, or declare a `stream` under `actuators:` of a module",
    )
    return None
