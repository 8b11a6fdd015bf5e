"""Elaboration of names with suffixes: fields, elements, ports, members of enumerations."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaboration import names
from koord.syntax.elaboration.body import CLOSED, CONTRACT, BodyScope
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.literals import field_position
from koord.syntax.elaboration.names import Meaning
from koord.syntax.elaboration.phrases import a, choice, did_you_mean, listed
from koord.syntax.elaboration.quantifiers import at_robot, primed
from koord.syntax.elaboration.recorder import HOLE, FieldSymbol, ModuleSymbol, TypeSymbol
from koord.syntax.elaboration.resolve_types import element_of
from koord.syntax.elaboration.symbols import RESERVED, ModuleScope, Poisoned
from koord.syntax.types import BOOL, INT, EnumType, FloatType, MapType, RecordType, SetType, Type


def meaning(body: BodyScope, e: ast.Expr, expected: Type | None = None) -> Meaning:
    """Elaborate an expression to the place or the value that it denotes."""
    match e:
        case ast.Name():
            return names.name(body, e, expected)
        case ast.Attribute() | ast.Index() | ast.AtRobot() | ast.Prime():
            with body.deeper(e) as allowed:
                return _composed(body, e) if allowed else None
        case _:
            return body.expr(e, expected)


def _composed(body: BodyScope, e: ast.Attribute | ast.Index | ast.AtRobot | ast.Prime) -> Meaning:
    match e:
        case ast.Attribute():
            return _attribute(body, e)
        case ast.Index():
            return _index(body, e)
        case ast.AtRobot(base=base):
            return at_robot(body, e, lambda: meaning(body, base))
        case ast.Prime(base=base):
            return primed(body, e, lambda: meaning(body, base))


def read(found: Meaning, e: ast.Expr) -> core.Expr | None:
    """The value of a place or value."""
    return core.Read(found, span=e.span) if isinstance(found, core.Place) else found


def stepped(found: core.Place | core.Expr, step: core.Step, e: ast.Expr) -> Meaning:
    """Elaborate a part of a place or value."""
    if isinstance(found, core.Place):
        return core.Place(
            found.variable, (*found.steps, step), found.robot, found.primed, span=e.span
        )
    return core.Select(found, step, span=e.span)


def _attribute(body: BodyScope, e: ast.Attribute) -> Meaning:
    if isinstance(e.base, ast.Name) and _is_free(body, e.base.name):
        owner = e.base.name
        if owner in body.session.types.named or _is_module(body, owner):
            return _qualified(body, e, owner)
        if is_unknown(body, owner):
            if not body.session.partial:
                from koord.syntax.elaboration.unknown_names import unknown

                unknown(body, e.base, e.name.name)
            return None
    base = _entry(body, e.base, meaning(body, e.base))
    if base is None:
        return None
    return field(body, base, e)


def _is_free(body: BodyScope, name: str) -> bool:
    """Return whether the name is not that of a variable."""
    session = body.session
    return (
        body.lookup(name) is None
        and name not in session.shared
        and not any(name in agent.variables for agent in session.agents)
    )


def is_unknown(body: BodyScope, name: str) -> bool:
    """Return whether the name has no meaning here."""
    session = body.session
    return (
        _is_free(body, name)
        and not any(name in agent.ports for agent in session.agents)
        and not session.member(name)
        and name not in RESERVED | {"delta"}
    )


def field(body: BodyScope, base: core.Place | core.Expr, e: ast.Attribute) -> Meaning:
    """Elaborate a field of a record."""
    record = base.type
    if e.name.name == HOLE:
        from koord.syntax.elaboration.candidates import fill_part

        fill_part(body, record)
    if not isinstance(record, RecordType):
        hint = None
        element = element_of(record)
        if element is not None and e.name.name in ("length", "len", "size"):
            hint = "the length of a list is `length(…)`"
        elif isinstance(element, RecordType):
            hint = f"its elements have fields: `…[i].{e.name.name}`"
        body.error("K205", e.name.span, f"{a(record)} has no fields", hint)
        return None
    found = field_position(record, e.name.name)
    if found is None and body.library and e.name.name == "assigned":
        owner = field_position(record, "assignedTo")
        if owner is not None and record.fields[owner][1] == INT:
            return _is_assigned(base, record, owner, e)
    if found is None:
        known = [name for name, _ in record.fields]
        body.error(
            "K205",
            e.name.span,
            f"`{record.name}` has no field `{e.name.name}`",
            did_you_mean(e.name.name, known) or choice("its fields are", known),
        )
        return None
    name, type_ = record.fields[found]
    body.note(e.name.span, FieldSymbol(record, found))
    return stepped(base, core.FieldStep(found, name, type_, span=e.name.span), e)


def _is_assigned(
    base: core.Place | core.Expr, record: RecordType, owner: int, e: ast.Attribute
) -> core.Expr:
    """Whether a task without ``assigned`` has a robot, whose number is not negative. [TASK]"""
    name, type_ = record.fields[owner]
    robot = read(stepped(base, core.FieldStep(owner, name, type_, span=e.name.span), e), e)
    assert robot is not None
    return core.Binary(core.BinaryOp.LE, core.Const(0, INT, span=e.span), robot, BOOL, span=e.span)


def _is_module(body: BodyScope, name: str) -> bool:
    session = body.session
    return name in session.library_ports or any(name in agent.modules for agent in session.agents)


def _qualified(body: BodyScope, e: ast.Attribute, owner: str) -> Meaning:
    kind = body.session.types.named.get(owner)
    if owner in body.session.types.named:
        body.note(e.base.span, TypeSymbol(owner, kind))
    else:
        body.note(e.base.span, ModuleSymbol(owner))
    if e.name.name == HOLE:
        from koord.syntax.elaboration.candidates import fill_owned

        fill_owned(body, owner, find_module(body, owner))
    if isinstance(kind, EnumType):
        return _member(body, e, kind)
    module = find_module(body, owner)
    if module is None:
        if owner in body.session.types.named:
            if kind is not None:
                body.error("K205", e.span, f"`{owner}` is a type, not a value")
            return None
        if not body.session.partial:
            body.error(
                "K207",
                e.span,
                f"the module `{owner}` is not in use here",
                f"begin the program with `using {owner}`",
            )
        return None
    port = module.ports.get(e.name.name)
    if port is None:
        known = body.session.library_ports.get(owner, frozenset()) | module.ports.keys()
        body.error(
            "K206",
            e.name.span,
            f"the module `{owner}` has no port `{e.name.name}`",
            did_you_mean(e.name.name, known) or choice("its ports are", sorted(known)),
        )
        return None
    body.note(e.name.span, port)
    if isinstance(port, Poisoned):
        return None
    return names.port_place(body, e, port)


def find_module(body: BodyScope, owner: str) -> ModuleScope | None:
    """The module with a name that the robots in question use."""
    kind = body.robot.kind if body.robot is not None else None
    if kind is not None:
        return body.session.agents[kind].modules.get(owner)
    if body.agent is not None and body.robot is None:
        return body.agent.modules.get(owner)
    return next((module for module in body.session.modules() if module.name == owner), None)


def _member(body: BodyScope, e: ast.Attribute, kind: EnumType) -> Meaning:
    if e.name.name in kind.members:
        for member in body.session.member(e.name.name):
            if member.type == kind:
                body.note(e.name.span, member)
        return core.Const(kind.members.index(e.name.name), kind, span=e.span)
    body.error(
        "K205",
        e.name.span,
        f"`{kind.name}` has no member `{e.name.name}`",
        did_you_mean(e.name.name, kind.members) or choice("its members are", kind.members),
    )
    return None


def _entry(body: BodyScope, base: ast.Expr, found: Meaning) -> Meaning:
    """Elaborate ``x@i`` and ``x.f @ i`` of an allread variable: the entry of robot ``i``."""
    if (
        isinstance(base, ast.Name)
        and isinstance(found, core.Place)
        and found.variable.home is core.Home.ALLREAD
        and not found.steps
        and body.robot is not None
        and body.where in CLOSED | CONTRACT
    ):
        return names.robot_entry(body, found, base)
    return found


def _index(body: BodyScope, e: ast.Index) -> Meaning:
    base = meaning(body, e.base)
    if base is None:
        body.expr(e.index)
        return None
    if isinstance(base.type, SetType):
        body.expr(e.index)
        hint = "ask `contains(s, x)`; write `s.add(x)`, `s.remove(x)`"
        body.error("K229", e.span, f"{a(base.type)} has no elements by number or key", hint)
        return None
    if isinstance(base.type, MapType):
        key = body.expr(e.index, base.type.key)
        key = fit(body, key, base.type.key, e.index.span, "the key")
        if key is None:
            return None
        return stepped(base, core.KeyStep(key, base.type.value, span=e.span), e)
    element = element_of(base.type)
    index = body.expr(e.index, INT)
    if element is None:
        body.error(
            "K229",
            e.span,
            f"{a(base.type)} has no elements",
            _pos_hint(base.type),
        )
        return None
    if index is not None and isinstance(index.type, FloatType):
        body.error(
            "K204",
            e.index.span,
            "an index is an `int`, but this is a `float`",
            "`int / int` is a whole number; keep positions in `int` variables",
        )
        return None
    index = fit(body, index, INT, e.index.span, "an index")
    if index is None:
        return None
    return stepped(base, core.IndexStep(index, element, span=e.span), e)


def _pos_hint(type_: Type) -> str | None:
    if isinstance(type_, RecordType):
        fields = listed(f".{name}" for name, _ in type_.fields)
        return f"its parts are {fields}"
    return None
