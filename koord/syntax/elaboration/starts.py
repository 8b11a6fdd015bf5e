"""Starts of variables: with a value, unset, or with any value that the assumptions allow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.settings import Settings
from koord.syntax.types import BOOL, FLOAT, INT, POS, ArrayType, ListType, RecordType, Type
from koord.syntax.walk import nodes


def initial_value(
    body: BodyScope, decl: ast.VarDecl, type_: Type, start: core.Start
) -> core.Expr | core.Start:
    """The initial value of a declaration, or ``start`` if it has none."""
    if decl.initial is None:
        return start
    value = body.expr(decl.initial, type_)
    what = f"the initial value of `{decl.name.name}`"
    fitted = fit(body, value, type_, decl.initial.span, what)
    return start if fitted is None else fitted


def agent(agent: core.Agent, kind: int, known: Assumed) -> core.Agent:
    """The agent with the starts of its locals and ports determined."""
    ports = settle([port.declaration for port in agent.ports], kind, known, Settings())
    return replace(
        agent,
        locals=settle(agent.locals, kind, known, Settings()),
        ports=tuple(
            replace(port, declaration=declaration)
            for port, declaration in zip(agent.ports, ports, strict=True)
        ),
    )


def settle(
    declarations: Iterable[core.Declaration], kind: int | None, known: Assumed, settings: Settings
) -> tuple[core.Declaration, ...]:
    """The declarations with their starts determined."""
    result = []
    for declaration in declarations:
        variable = declaration.variable
        found = key(variable, kind)
        start, length = declaration.initial, None
        if start is core.Start.UNSET:
            start = tasks(variable, settings) or start
        if start is core.Start.UNSET and found in known.read:
            start = core.Start.ARBITRARY
        if start is core.Start.ARBITRARY:
            length = known.lengths.get(found)
        result.append(replace(declaration, initial=start, length=length))
    return tuple(result)


Key = tuple[core.Home, int | None, int]


def key(variable: core.Variable, kind: int | None) -> Key:
    """A key for a variable: slots of locals count per kind of robot."""
    local = variable.home in (core.Home.LOCAL, core.Home.PORT)
    return (variable.home, kind if local else None, variable.slot)


class Assumed(Struct, frozen=True):
    """The variables that the assumptions read, and the lengths of lists that they fix."""

    read: frozenset[Key]
    lengths: dict[Key, int]


def assumed(assumptions: Iterable[core.Assumption], kinds: int) -> Assumed:
    """Find the variables that assumptions read, and the list lengths that they fix."""
    read: set[Key] = set()
    lengths: dict[Key, int] = {}
    for assumption in assumptions:
        for place, kind in places_read(assumption.condition):
            for each in range(kinds) if kind is None else (kind,):
                read.add(key(place.variable, each))
        for found, length in fixed_lengths(assumption.condition, kinds).items():
            lengths.setdefault(found, length)
    return Assumed(frozenset(read), lengths)


def places_read(expr: core.Expr) -> Iterator[tuple[core.Place, int | None]]:
    """Every place that the expression reads, with the kind of its robot where only one can be."""
    kinds: dict[int, int | None] = {}
    for node in nodes(expr):
        match node:
            case core.Quantified(variable=variable, domain=core.RobotRange(agent=agent)):
                kinds[variable.slot] = agent
            case core.Place(robot=core.Read(place=core.Place(variable=robot))):
                yield node, kinds.get(robot.slot) if robot.home is core.Home.BOUND else None
            case core.Place():
                yield node, None


def fixed_lengths(condition: core.Expr, kinds: int) -> dict[Key, int]:
    """The lists whose length an assumption fixes: ``length(x) == c``, for all robots or plainly."""
    result: dict[Key, int] = {}
    robots: dict[int, int | None] = {}
    stack = [condition]
    while stack:
        match stack.pop():
            case core.Binary(op=core.BinaryOp.AND, left=left, right=right):
                stack.extend((left, right))
            case core.Quantified(
                quantifier=core.QuantifierKind.FORALL,
                variable=variable,
                domain=core.RobotRange(agent=agent),
                body=inner,
            ):
                robots[variable.slot] = agent
                stack.append(inner)
            case core.Binary(op=core.BinaryOp.EQ, left=left, right=right):
                for list_, size in ((left, right), (right, left)):
                    for found in _fixed(list_, size, robots, kinds):
                        result.setdefault(found[0], found[1])
    return result


def _fixed(
    list_: core.Expr, size: core.Expr, robots: dict[int, int | None], kinds: int
) -> Iterator[tuple[Key, int]]:
    match list_, size:
        case (
            core.Builtin(op=core.ListOp.LENGTH, arguments=(core.Read(place=place),)),
            core.Const(value=int() as length),
        ) if length >= 0:
            pass
        case _:
            return
    variable = place.variable
    match variable.home:
        case core.Home.ALLWRITE if not place.steps:
            yield key(variable, None), length
        case core.Home.ALLREAD if len(place.steps) == 1:
            step = place.steps[0]
            if isinstance(step, core.IndexStep) and _robot(step.index, robots) is not None:
                yield key(variable, None), length
        case core.Home.LOCAL | core.Home.PORT if not place.steps:
            robot = _robot(place.robot, robots)
            if robot is not None:
                for kind in range(kinds) if robot[0] is None else (robot[0],):
                    yield key(variable, kind), length
        case _:
            return


def _robot(expr: core.Expr | None, robots: dict[int, int | None]) -> tuple[int | None] | None:
    """The kind of robot that a quantified variable goes through, or None if it is no such."""
    match expr:
        case core.Read(place=core.Place(variable=variable, steps=())) if (
            variable.home is core.Home.BOUND and variable.slot in robots
        ):
            return (robots[variable.slot],)
        case _:
            return None


def check_tasks(
    declarations: Iterable[core.Declaration], settings: Settings, findings: DiagnosticLog
) -> None:
    """Check that an array of tasks has as many elements as the world has tasks."""
    for declaration in declarations:
        match declaration.variable.type:
            case ArrayType(element=RecordType(name="Task"), size=int() as size):
                pass
            case _:
                continue
        places = settings.tasks
        if places is None or len(places) == size or declaration.initial is not core.Start.UNSET:
            continue
        name = declaration.variable.name
        findings.error(
            "K246",
            declaration.span,
            f"`{name}` has {size} elements, but the world has {len(places)} tasks",
            f"declare it as `Task[] {name}`, or set its size with `params=`",
        )


def takes_tasks(variable: core.Variable) -> bool:
    """Return whether a variable without a value starts with the world's tasks, if there are any."""
    match variable.type:
        case ListType(element=RecordType(name="Task")) | ArrayType(element=RecordType(name="Task")):
            return variable.home is core.Home.ALLWRITE
        case _:
            return False


def tasks(variable: core.Variable, settings: Settings) -> core.Expr | None:
    """The tasks of the world, for an allwrite list of tasks."""
    if settings.tasks is None or variable.home is not core.Home.ALLWRITE:
        return None
    match variable.type:
        case ListType(element=RecordType(name="Task") as task):
            pass
        case ArrayType(element=RecordType(name="Task") as task, size=size) if size == len(
            settings.tasks
        ):
            pass
        case _:
            return None
    made = [_task(task, number, place) for number, place in enumerate(settings.tasks)]
    found = tuple(value for value in made if value is not None)
    return core.MakeList(found, variable.type) if len(found) == len(made) else None


def with_tasks(program: core.Program, places: core.Places) -> core.Program:
    """A program that was elaborated without places of tasks, with the world's tasks.

    It is what elaborating its text with them gives, if as many as its arrays have elements.
    """
    settings = Settings(tasks=places)
    started = []
    for declaration in program.allwrite:
        found = None
        if isinstance(declaration.initial, core.Start):
            found = tasks(declaration.variable, settings)
        if found is not None:
            declaration = replace(declaration, initial=found, length=None)
        started.append((declaration, found is not None))
    return replace(
        program,
        allwrite=tuple(declaration for declaration, _ in started),
        tasks=places if any(is_started for _, is_started in started) else None,
    )


def _task(
    task: RecordType, number: int, place: tuple[Fraction, Fraction, Fraction]
) -> core.Expr | None:
    values: list[core.Expr] = []
    for name, type_ in task.fields:
        match name, type_:
            case "loc" | "target", _ if type_ == POS:
                parts = tuple(core.Const(part, FLOAT) for part in place)
                values.append(core.MakeRecord(parts, POS))
            case "assigned", _ if type_ == BOOL:
                values.append(core.Const(False, BOOL))
            case "assignedTo" | "assignId", _ if type_ == INT:
                values.append(core.Const(-1, INT))
            case "id" | "taskId", _ if type_ == INT:
                values.append(core.Const(number, INT))
            case _:
                return None
    return core.MakeRecord(tuple(values), task)
