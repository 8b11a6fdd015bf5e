"""The tasks that the configuration of the world lists."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from koord.syntax import core
from koord.syntax.elaborate.findings import Findings
from koord.syntax.elaborate.settings import Settings
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    ArrayType,
    ListType,
    RecordType,
)


def check_tasks(
    declarations: Iterable[core.Declaration], settings: Settings, findings: Findings
) -> None:
    """An array of tasks has as many elements as the world has tasks."""
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
            f"declare it as `Task[] {name}`, or set its size with `--set`",
        )


def takes_tasks(variable: core.Variable) -> bool:
    """Whether a variable without a value begins with the tasks of the world, if there are any."""
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
