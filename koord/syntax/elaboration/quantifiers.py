"""Elaboration of quantifiers, ``v@i``, primed ports and ``ran``: outside of robots' turns only."""

from __future__ import annotations

from collections.abc import Callable

from koord.syntax import ast, core
from koord.syntax.elaboration.body import (
    CLOSED,
    CONTRACT,
    LOGICAL,
    SUMMARIES,
    BodyScope,
    RobotScope,
    Where,
)
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.literals import gone_through
from koord.syntax.elaboration.names import Meaning, robot_entry
from koord.syntax.elaboration.phrases import a, did_you_mean
from koord.syntax.elaboration.recorder import HOLE, EventSymbol, KindSymbol, OwnName
from koord.syntax.elaboration.resolve_types import element_of, resolve
from koord.syntax.elaboration.symbols import Role
from koord.syntax.types import BOOL, INT, Type

_KINDS = {
    ast.Quantifier.FORALL: core.QuantifierKind.FORALL,
    ast.Quantifier.EXISTS: core.QuantifierKind.EXISTS,
}


def quantified(body: BodyScope, e: ast.Quantified) -> core.Expr | None:
    """Elaborate ``forall i, j: …`` as nested quantifiers, the first outermost."""
    if body.where not in LOGICAL:
        body.error(
            "K301",
            e.span,
            f"`{e.quantifier.value}` stands in properties, contracts and summaries only",
            "in a program, go through the robots or the list with `for`",
        )
    kind = _KINDS[e.quantifier]
    layers: list[tuple[core.Variable, core.QuantifierDomain]] = []
    sound = True
    with body.frame():
        for binder in e.binders:
            for name in binder.names:
                layer = _binder(body, binder, name)
                sound = sound and layer is not None
                if layer is not None:
                    layers.append(layer)
        inner = fit(body, body.expr(e.body, BOOL), BOOL, e.body.span, "what is said of all or some")
    if inner is None or not sound or body.where not in LOGICAL:
        return None
    for variable, domain in reversed(layers):
        inner = core.Quantified(kind, variable, domain, inner, span=e.span)
    return inner


def _binder(
    body: BodyScope, binder: ast.Binder, name: ast.Ident
) -> tuple[core.Variable, core.QuantifierDomain] | None:
    if binder.type is not None:
        return _typed(body, binder, binder.type, name)
    if binder.low is not None:
        return _range(body, binder, name)
    if binder.over is not None:
        return _elements(body, binder.over, name)
    return _bind(body, name, INT, core.RobotRange())


def _bind(
    body: BodyScope,
    name: ast.Ident,
    type_: Type | None,
    domain: core.QuantifierDomain | None,
    kind: int | None = None,
) -> tuple[core.Variable, core.QuantifierDomain] | None:
    symbol = body.declare(name, type_, Role.QUANTIFIED, kind)
    if symbol.variable is None or domain is None:
        return None
    return symbol.variable, domain


def _range(
    body: BodyScope, binder: ast.Binder, name: ast.Ident
) -> tuple[core.Variable, core.QuantifierDomain] | None:
    assert binder.low is not None
    low = fit(body, body.expr(binder.low, INT), INT, binder.low.span, "the start of a range")
    if binder.high is None:
        body.error("K201", binder.span, "this range has no end", "write `k in 0, n`")
        return _bind(body, name, INT, None)
    high = fit(body, body.expr(binder.high, INT), INT, binder.high.span, "the end of a range")
    domain = core.IntRange(low, high) if low is not None and high is not None else None
    return _bind(body, name, INT, domain)


def _elements(
    body: BodyScope, over: ast.Expr, name: ast.Ident
) -> tuple[core.Variable, core.QuantifierDomain] | None:
    sequence = gone_through(body, over)
    if sequence is None:
        return _bind(body, name, None, None)
    element = element_of(sequence.type)
    if element is None:
        body.error("K229", over.span, f"{a(sequence.type)} has no elements to go through")
        return _bind(body, name, None, None)
    return _bind(body, name, element, core.Elements(sequence))


def _typed(
    body: BodyScope, binder: ast.Binder, type_: ast.TypeExpr, name: ast.Ident
) -> tuple[core.Variable, core.QuantifierDomain] | None:
    if isinstance(type_, ast.NamedType) and not type_.arguments:
        for agent in body.session.agents:
            if agent.name and agent.name == type_.name:
                body.note(type_.span, KindSymbol(agent.name))
                return _bind(body, name, INT, core.RobotRange(agent.index), agent.index)
    if body.where not in SUMMARIES:
        if not body.session.partial and body.where in LOGICAL:
            body.error(
                "K306",
                binder.span,
                "only the summary of an external function speaks of every value of a type",
                "go through robots (`forall i:`), a range (`forall k in 0, n:`), the elements of a "
                "list (`forall t in list:`), or the robots of a kind (`forall Car c:`)",
            )
        return _bind(body, name, None, None)
    found = resolve(body, type_)
    return _bind(body, name, found, None if found is None else core.AllValues(found))


def at_robot(body: BodyScope, e: ast.AtRobot, base: Callable[[], Meaning]) -> Meaning:
    """Elaborate ``v@i``: the base, with the locals and ports of robot ``i``."""
    if body.where not in CLOSED | CONTRACT:
        body.error(
            "K302",
            e.span,
            "`@` stands in properties and contracts only",
            "a robot sees others through `allread` and `allwrite` variables",
        )
        base()
        return None
    robot = fit(body, body.expr(e.robot, INT), INT, e.robot.span, "the robot behind `@`")
    if robot is None:
        base()
        return None
    outer = body.robot
    body.robot = RobotScope(robot, _kind(body, e.robot))
    try:
        found = base()
        if (
            isinstance(found, core.Place)
            and found.variable.home is core.Home.ALLREAD
            and not found.steps
        ):
            found = robot_entry(body, found, e)
        if found is not None and not body.robot.used:
            cure = "leave out the `@`"
            if isinstance(e.base, ast.Name) and body.lookup(e.base.name) is not None:
                cure = f"`{e.base.name}` is what a quantifier binds here: give that another name"
            body.error(
                "K302",
                e.span,
                "this is the same for all robots, so that there is nothing for `@` to choose",
                cure,
            )
            return None
    finally:
        body.robot = outer
    return found


def _kind(body: BodyScope, robot: ast.Expr) -> int | None:
    if isinstance(robot, ast.Name):
        symbol = body.lookup(robot.name)
        if symbol is not None and symbol.kind is not None:
            return symbol.kind
    return 0 if body.session.single else None


def primed(body: BodyScope, e: ast.Prime, base: Callable[[], Meaning]) -> Meaning:
    """Elaborate ``x'``: the port after the environment's turn."""
    if body.where is not Where.ENSURES:
        body.error(
            "K303",
            e.span,
            "a primed name, the value after a step, stands in the `ensures:` of a contract only",
            "an invariant speaks of one configuration at a time",
        )
        base()
        return None
    outer, body.primed = body.primed, True
    try:
        return base()
    finally:
        body.primed = outer


def ran(body: BodyScope, e: ast.Call) -> core.Expr | None:
    """Elaborate ``ran(E)``, of the robot that ``@`` names or of every robot."""
    if body.where not in CLOSED:
        body.error(
            "K304",
            e.span,
            "`ran` stands in properties only",
            "to remember an event, set a local variable in it",
        )
        return None
    argument = e.arguments[0].value if len(e.arguments) == 1 else None
    if not isinstance(argument, ast.Name):
        body.error("K304", e.span, "`ran` wants the name of one event", "write `ran(Event)@i`")
        return None
    events = tuple(
        (agent.index, agent.events[argument.name])
        for agent in body.session.agents
        if argument.name in agent.events
    )
    if argument.name == HOLE:
        from koord.syntax.elaboration.candidates import fill_events

        fill_events(body)
    if not events:
        known = [name for agent in body.session.agents for name in agent.events]
        if not body.session.partial:
            hint = did_you_mean(argument.name, known)
            body.error("K304", argument.span, f"there is no event `{argument.name}`", hint)
        return None
    body.note(e.function.span, OwnName("ran"))
    body.note(argument.span, EventSymbol(argument.name))
    if body.robot is not None:
        body.robot.used = True
        robot = body.robot.expr
    else:
        robot = core.Read(core.Place(body.pid(), span=e.span), span=e.span)
    return core.Ran(events, robot, span=e.span)
