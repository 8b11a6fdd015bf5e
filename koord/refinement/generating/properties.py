"""Random statements about configurations: properties, assumptions, contracts."""

from __future__ import annotations

from koord.refinement.generating.drafts import Context, Draft, ReadScope, Slots
from koord.refinement.generating.expressions import expression
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind, QuantifierKind
from koord.syntax.types import BOOL, INT, ArrayType, ListType, Type


def about_configurations(
    draft: Draft, shared: list[core.Variable], agents: tuple[core.Agent, ...]
) -> Context:
    """The context of a closed statement: everybody's variables, and nobody's ``pid``."""
    variables = shared.copy()
    kinds: dict[tuple[Home, str], int] = {}
    events: list[tuple[int, int, str]] = []
    for kind, agent in enumerate(agents):
        entries = [*agent.locals, *(port.declaration for port in agent.ports)]
        for entry in entries:
            kinds[entry.variable.home, entry.variable.name] = kind
            variables.append(entry.variable)
        events += [(kind, position, e.name) for position, e in enumerate(agent.events)]
    return Context(
        draft,
        Slots(),
        variables=variables,
        kinds=kinds,
        events=events,
        pid=False,
        in_property=True,
        calls=ReadScope.SHARED if draft.chance(0.3) else None,
        externals=False,
    )


def property_(
    draft: Draft,
    name: str,
    kind: PropertyKind,
    shared: list[core.Variable],
    agents: tuple[core.Agent, ...],
) -> core.Property:
    c = about_configurations(draft, shared, agents)
    condition = closed(c)
    trigger = closed(c) if kind is PropertyKind.LEADS_TO else None
    return core.Property(name, kind, condition, c.slots.used, trigger, span=draft.span())


def assumption(
    draft: Draft, name: str, shared: list[core.Variable], agents: tuple[core.Agent, ...]
) -> core.Assumption:
    c = about_configurations(draft, shared, agents)
    return core.Assumption(name, closed(c), c.slots.used, span=draft.span())


def closed(c: Context, quantifiers: int = 2) -> core.Expr:
    """A Boolean under up to two quantifiers."""
    draft = c.draft
    count = draft.weighted([(1, 0), (4, 1), (3, 2)]) if quantifiers == 2 else quantifiers
    if count == 0:
        return _atoms(c)
    inner = c.inner()
    quantifier = draft.weighted([(3, QuantifierKind.FORALL), (1, QuantifierKind.EXISTS)])
    domain, type_, agent = _domain(c)
    variable = inner.slots.fresh(draft, type_)
    inner.bound.append(variable)
    if isinstance(domain, core.RobotRange):
        inner.robots.append((variable, agent))
    body = closed(inner, count - 1)
    return core.Quantified(quantifier, variable, domain, body, BOOL, span=draft.span())


def _domain(c: Context) -> tuple[core.QuantifierDomain, Type, int | None]:
    draft = c.draft
    number_of_agents = 1 + max((kind for kind, _, _ in c.events), default=0)
    match draft.weighted([(5, "robots"), (1, "range"), (1, "elements")]):
        case "robots":
            agent = draft.random.randrange(number_of_agents) if draft.chance(0.7) else None
            return core.RobotRange(agent), INT, agent
        case "range":
            low = core.Const(0, INT, span=draft.span())
            high: core.Expr = core.Const(2, INT, span=draft.span())
            if draft.chance(0.5):
                high = core.NumAgents(INT, span=draft.span())
            return core.IntRange(low, high), INT, None
        case _:
            types = [v.type for v in c.variables if isinstance(v.type, ListType | ArrayType)]
            type_: Type = draft.pick(types) if types else ListType(draft.scalar())
            assert isinstance(type_, ListType | ArrayType)
            over = expression(c, type_, 1)
            return core.Elements(over), type_.element, None


def _atoms(c: Context) -> core.Expr:
    """The body of a statement under its quantifiers."""
    draft = c.draft
    if c.robots and draft.chance(0.25):
        place = core.Place(draft.pick(c.robots)[0], span=draft.span())
        robot = core.Read(place, span=draft.span())
        of_robot: core.Expr = core.Stopped(robot, span=draft.span())
        if c.events and draft.chance(0.6):
            name = draft.pick(c.events)[2]
            events = tuple((kind, position) for kind, position, n in c.events if n == name)
            of_robot = core.Ran(events, robot, span=draft.span())
        op = draft.pick((core.BinaryOp.IMPLIES, core.BinaryOp.AND, core.BinaryOp.OR))
        return core.Binary(op, of_robot, expression(c, BOOL, 2), BOOL, span=draft.span())
    return expression(c, BOOL, draft.profile.depth)


# --- contracts ----------------------------------------------------------------------------------


def contract(draft: Draft, ports: list[core.Port], own: list[core.Port]) -> core.Contract:
    """A contract about the ports of one module; primed ports stand in ``ensures`` only."""
    before = Context(
        draft,
        Slots(),
        variables=[p.declaration.variable for p in ports],
        calls=ReadScope.NOTHING,
        externals=False,
    )
    requires = (expression(before, BOOL, 1),) if draft.chance(0.4) else ()
    after = before.inner()
    after.primed = [p.declaration.variable for p in own]
    ensures = [expression(after, BOOL, 2)] if draft.chance(0.5) else []
    bounds = [core.Binary(*bound, BOOL, span=draft.span()) for bound in _bounds(draft, own)]
    return core.Contract(draft.name("promise"), requires, (*bounds, *ensures), span=draft.span())


def _bounds(draft: Draft, own: list[core.Port]) -> list[tuple[core.BinaryOp, core.Expr, core.Expr]]:
    """The promises ``low <= port'`` and ``port' <= high`` for integer sensors."""
    bounds: list[tuple[core.BinaryOp, core.Expr, core.Expr]] = []
    for port in own:
        if port.direction is core.Direction.SENSOR and port.declaration.variable.type == INT:
            place = core.Place(port.declaration.variable, primed=True, span=draft.span())
            read = core.Read(place, span=draft.span())
            low = core.Const(0, INT, span=draft.span())
            high = core.Const(draft.pick((1, 2)), INT, span=draft.span())
            bounds += [(core.BinaryOp.LE, low, read), (core.BinaryOp.LE, read, high)]
    return bounds
