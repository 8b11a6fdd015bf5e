"""Random typed core programs, and systems of them."""

from __future__ import annotations

from random import Random

from koord.refinement.generating.drafts import Context, Draft, ReadScope, Slots
from koord.refinement.generating.expressions import expression
from koord.refinement.generating.palette import GENERAL, Profile, palette
from koord.refinement.generating.properties import assumption, contract, property_
from koord.refinement.generating.statements import FunctionType, block, function
from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, ExternalKind, Home, PropertyKind, Start
from koord.syntax.system import System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    GrowingType,
    ListType,
    MapType,
    RecordType,
    Robots,
    Type,
)


def system(random: Random, profile: Profile = GENERAL) -> System:
    """A random program with some robots, of random kinds."""
    made = program(random, profile)
    robots = random.randint(*profile.robots)
    return System(made, tuple(random.randrange(len(made.agents)) for _ in range(robots)))


def program(random: Random, profile: Profile = GENERAL) -> core.Program:
    """A random program."""
    draft = Draft(random, profile, palette(random, finite=profile.finite))
    shapes = _shared_shapes(draft)
    for _ in range(draft.between(profile.externals)):
        draft.externals.append(_external(draft))
    allread, allwrite = _shared(draft, shapes)
    shared = [entry.variable for entry in (*allread, *allwrite)]
    for _ in range(draft.between(profile.functions)):
        draft.functions.append(_function(draft, shared))
    classes = {slot: draft.random.randint(0, 1) for slot in range(len(allwrite))}
    count = draft.between(profile.agents)
    agents = tuple(_Agent(draft, kind, shared, classes).build() for kind in range(count))
    return core.Program(
        name="generated",
        agents=agents,
        allread=allread,
        allwrite=allwrite,
        functions=tuple(f for _, f in draft.functions),
        externals=tuple(draft.externals),
        lock_classes=_lock_classes(allwrite, classes),
        assumptions=_assumptions(draft, shared, agents),
        properties=_properties(draft, shared, agents),
    )


def _lock_classes(
    allwrite: tuple[core.Declaration, ...], classes: dict[int, int]
) -> tuple[core.LockClass, ...]:
    names: dict[int, list[str]] = {0: []}
    for entry in allwrite:
        names.setdefault(classes[entry.variable.slot], []).append(entry.variable.name)
    return tuple(core.LockClass(index, tuple(names.get(index, ()))) for index in range(2))


def _assumptions(
    draft: Draft, shared: list[core.Variable], agents: tuple[core.Agent, ...]
) -> tuple[core.Assumption, ...]:
    """Assumptions that bound arbitrary integers, and now and then others."""
    made = []
    for kind, agent in enumerate(agents):
        entries = [*agent.locals, *(port.declaration for port in agent.ports)]
        for entry in entries:
            if entry.initial is Start.ARBITRARY and entry.variable.type == INT:
                made.append(_small(draft, entry.variable, kind))
    if draft.chance(0.1):
        made.append(assumption(draft, draft.name("assumption"), shared, agents))
    return tuple(made)


def _small(draft: Draft, variable: core.Variable, kind: int) -> core.Assumption:
    """The assumption ``forall i: 0 <= v@i and v@i <= high``."""
    robot = core.Variable(Home.BOUND, 0, "i", INT)
    of_robot = core.Read(core.Place(robot, span=draft.span()), span=draft.span())
    read = core.Read(core.Place(variable, robot=of_robot, span=draft.span()), span=draft.span())
    low = core.Const(0, INT, span=draft.span())
    high = core.Const(draft.pick((1, 2)), INT, span=draft.span())
    above = core.Binary(BinaryOp.LE, low, read, BOOL, span=draft.span())
    below = core.Binary(BinaryOp.LE, read, high, BOOL, span=draft.span())
    both = core.Binary(BinaryOp.AND, above, below, BOOL, span=draft.span())
    closed = core.Quantified(
        core.QuantifierKind.FORALL, robot, core.RobotRange(kind), both, BOOL, span=draft.span()
    )
    return core.Assumption(draft.name("assumption"), closed, 1, span=draft.span())


def _properties(
    draft: Draft, shared: list[core.Variable], agents: tuple[core.Agent, ...]
) -> tuple[core.Property, ...]:
    kinds = [PropertyKind.INVARIANT, draft.pick((PropertyKind.INVARIANT, PropertyKind.AT_ROUND))]
    if not draft.profile.finite and draft.chance(0.2):
        kinds.append(draft.pick((PropertyKind.EVENTUALLY, PropertyKind.LEADS_TO)))
    return tuple(property_(draft, draft.name("property"), kind, shared, agents) for kind in kinds)


# --- declarations -------------------------------------------------------------------------------


def _shared_shapes(draft: Draft) -> list[tuple[Home, Type]]:
    count = draft.between(draft.profile.shared)
    homes = [draft.pick((Home.ALLREAD, Home.ALLWRITE, Home.ALLWRITE)) for _ in range(count)]
    return [(home, draft.type()) for home in homes]


def _shared(
    draft: Draft, shapes: list[tuple[Home, Type]]
) -> tuple[tuple[core.Declaration, ...], tuple[core.Declaration, ...]]:
    """Shared variables; an initial value may read what was started before it."""
    allread: list[core.Declaration] = []
    allwrite: list[core.Declaration] = []
    for home, type_ in shapes:
        entries = allread if home is Home.ALLREAD else allwrite
        whole = ArrayType(type_, Robots.ALL) if home is Home.ALLREAD else type_
        variable = core.Variable(home, len(entries), draft.name(home.value), whole)
        c = Context(
            draft,
            Slots(),
            pid=home is Home.ALLREAD,
            calls=None,
            externals=False,
            variables=[entry.variable for entry in allwrite],
        )
        initial = _initial(c, type_)
        if initial is Start.UNSET:
            draft.unset.add(variable.name)
        entries.append(core.Declaration(variable, initial, span=draft.span()))
    return tuple(allread), tuple(allwrite)


def _initial(c: Context, type_: Type) -> core.Expr | Start:
    draft = c.draft
    if draft.chance(draft.profile.unset):
        return Start.UNSET
    return expression(c, type_, draft.profile.depth - 1)


def is_finite(type_: Type, *, ints: bool) -> bool:
    """Return whether a type has few values; integers count where something bounds them."""
    match type_:
        case BoolType() | EnumType():
            return True
        case RecordType(fields=fields):
            return all(is_finite(field, ints=False) for _, field in fields)
        case _:
            return ints and type_ == INT


def _open_type(draft: Draft, *, ints: bool) -> Type:
    """A type for something that is left open."""
    if not draft.profile.finite:
        return draft.type()
    suitable = [
        t for t in draft.palette.all if is_finite(t, ints=ints and draft.profile.calculates)
    ]
    return draft.pick(suitable)


# --- functions ----------------------------------------------------------------------------------


def _function(draft: Draft, shared: list[core.Variable]) -> tuple[ReadScope, core.Function]:
    reach = draft.pick(tuple(ReadScope))
    c = Context(
        draft,
        Slots(),
        variables=shared if reach >= ReadScope.SHARED else [],
        pid=reach is ReadScope.ROBOT,
        calls=reach,
        externals=False,
    )
    parameters = tuple(draft.type() for _ in range(draft.random.randint(0, 2)))
    return reach, function(c, draft.name("f"), FunctionType(parameters, draft.type()))


def _external(draft: Draft) -> core.External:
    """An external function whose summary can mostly be met."""
    slots = Slots()
    count = draft.random.randint(0, 2)
    parameters = tuple(slots.fresh(draft, draft.type()) for _ in range(count))
    result = slots.fresh(draft, _open_type(draft, ints=False))
    c = Context(
        draft, slots, bound=list(parameters), pid=False, calls=ReadScope.NOTHING, externals=False
    )
    requires = (expression(c, BOOL, 1),) if draft.chance(draft.profile.faulty) else ()
    c.bound.append(result)
    ensures: list[core.Expr] = []
    if draft.chance(0.4):
        ensures.append(_likely(draft, c, result))
    fresh = draft.profile.finite or draft.chance(0.5)
    kind = ExternalKind.FRESH if fresh else ExternalKind.FUNCTION
    return core.External(
        draft.name("g"), parameters, result, kind, requires, tuple(ensures), slots.used,
        span=draft.span(),
    )  # fmt: skip


def _likely(draft: Draft, c: Context, result: core.Variable) -> core.Expr:
    """A promise that many answers keep."""
    read = core.Read(core.Place(result, span=draft.span()), span=draft.span())
    match result.type:
        case BoolType():
            either = core.Binary(BinaryOp.OR, read, expression(c, BOOL, 1), BOOL, span=draft.span())
            return either
        case GrowingType() | MapType():
            length = core.Builtin(core.ListOp.LENGTH, (read,), INT, span=draft.span())
            limit = core.Const(2, INT, span=draft.span())
            return core.Binary(BinaryOp.LE, length, limit, BOOL, span=draft.span())
        case _ if result.type == INT:
            low = core.Const(0, INT, span=draft.span())
            return core.Binary(BinaryOp.LE, low, read, BOOL, span=draft.span())
        case _:
            return core.Binary(
                BinaryOp.OR,
                expression(c, BOOL, 1),
                core.Const(True, BOOL, span=draft.span()),
                BOOL,
                span=draft.span(),
            )


# --- agents -------------------------------------------------------------------------------------


class _Agent:
    """A kind of robot under construction."""

    def __init__(
        self, draft: Draft, kind: int, shared: list[core.Variable], classes: dict[int, int]
    ) -> None:
        self.draft, self.kind, self.shared, self.classes = draft, kind, shared, classes
        self.ports: list[core.Port] = []
        self.locals: list[core.Declaration] = []

    def build(self) -> core.Agent:
        draft = self.draft
        modules = tuple(self._module() for _ in range(draft.between(draft.profile.modules)))
        # Until INIT is over, nobody has another robot's entries.
        not_yet = {v.name for v in self.shared if v.home is Home.ALLREAD} - draft.unset
        draft.unset |= not_yet
        self._declare_locals()
        init_context = self._context(choices=True)
        init = block(init_context, 1) if draft.chance(0.4) else ()
        draft.unset -= not_yet
        events = tuple(self._event() for _ in range(draft.between(draft.profile.events)))
        return core.Agent(
            f"Kind{self.kind}",
            tuple(self.locals),
            tuple(self.ports),
            modules,
            init,
            init_context.slots.used,
            events,
            span=draft.span(),
        )

    def _context(self, *, choices: bool = False, locks: bool = False) -> Context:
        own = [entry.variable for entry in self.locals]
        ports = [port.declaration.variable for port in self.ports]
        actuators = [
            port.declaration.variable for port in self.ports if port.direction is Direction.ACTUATOR
        ]
        return Context(
            self.draft,
            Slots(),
            variables=[*own, *ports, *self.shared],
            writable=[*own, *actuators, *self.shared],
            choices=choices,
            may_lock=locks,
            classes=self.classes,
        )

    def _declare_locals(self) -> None:
        draft = self.draft
        for slot in range(draft.between(draft.profile.locals)):
            type_ = draft.type()
            variable = core.Variable(Home.LOCAL, slot, draft.name("local"), type_)
            initial: core.Expr | Start = _initial(self._context(), type_)
            if draft.chance(draft.profile.arbitrary) and self._may_be_open(type_):
                initial = Start.ARBITRARY
            length = draft.random.randint(0, 2) if isinstance(type_, ListType) else None
            length = length if initial is Start.ARBITRARY else None
            if initial is Start.UNSET:
                draft.unset.add(variable.name)
            self.locals.append(core.Declaration(variable, initial, length, span=draft.span()))

    def _may_be_open(self, type_: Type) -> bool:
        profile = self.draft.profile
        return not profile.finite or is_finite(type_, ints=profile.calculates)

    def _event(self) -> core.Event:
        draft = self.draft
        c = self._context(locks=True)
        guard: core.Expr = core.Const(True, BOOL, span=draft.span())
        if draft.chance(0.7):
            guard = expression(c, BOOL, draft.profile.depth)
        effect = block(c, draft.profile.nesting)
        return core.Event(
            draft.name("event"),
            draft.chance(draft.profile.urgent),
            guard,
            effect,
            c.slots.used,
            frozenset(c.entered),
            span=draft.span(),
        )

    # --- modules --------------------------------------------------------------------------------

    def _module(self) -> core.Module:
        draft = self.draft
        name, first = draft.name("Module"), len(self.ports)
        modelled = draft.chance(0.4)
        for _ in range(draft.random.randint(1, 2)):
            self._port(name, Direction.SENSOR, modelled=modelled)
        if draft.chance(0.5):
            self._port(name, Direction.ACTUATOR, modelled=modelled)
        own = self.ports[first:]
        contracts = tuple(
            contract(draft, self.ports, own)
            for _ in range(1)
            if draft.chance(0.5) or (not modelled and draft.profile.finite)
        )
        slots = Slots()
        environment = self._environment(own, slots) if modelled else None
        positions = tuple(range(first, len(self.ports)))
        return core.Module(name, positions, environment, slots.used, contracts, span=draft.span())

    def _port(self, module: str, direction: Direction, *, modelled: bool) -> None:
        draft = self.draft
        closed = modelled or direction is Direction.ACTUATOR
        type_ = draft.type() if closed else _open_type(draft, ints=True)
        variable = core.Variable(Home.PORT, len(self.ports), draft.name("port"), type_)
        c = Context(draft, Slots(), calls=ReadScope.NOTHING, externals=False)
        initial: core.Expr | Start = expression(c, type_, 1)
        if direction is Direction.SENSOR and self._may_be_open(type_) and draft.chance(0.5):
            initial = Start.ARBITRARY
        entry = core.Declaration(variable, initial, span=draft.span())
        self.ports.append(core.Port(module, direction, entry, span=draft.span()))

    def _environment(self, own: list[core.Port], slots: Slots) -> core.Block:
        c = Context(
            self.draft,
            slots,
            variables=[port.declaration.variable for port in self.ports],
            writable=[port.declaration.variable for port in own],
            choices=True,
        )
        c.calls = ReadScope.NOTHING
        return block(c, 1)
