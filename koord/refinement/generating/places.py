"""Random places: a variable and some steps into it."""

from __future__ import annotations

from functools import lru_cache

from koord.refinement.generating import expressions
from koord.refinement.generating.drafts import Context
from koord.refinement.generating.palette import Path, Stage, Way, end, paths
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.types import INT, ArrayType, GrowingType, Robots, Type


@lru_cache(maxsize=4096)
def _paths(type_: Type) -> tuple[tuple[Path, Type], ...]:
    return tuple((path, end(type_, path)) for path in paths(type_))


def readable(c: Context, type_: Type, depth: int) -> core.Place | None:
    """A place of a type that may be read, if there is one."""
    daring = c.draft.chance(c.draft.profile.faulty)
    found = [
        (variable, path, False)
        for variable in [*c.variables, *c.bound]
        if _is_in_reach(c, variable) and (daring or variable.name not in c.draft.unset)
        for path, its_type in _paths(variable.type)
        if its_type == type_ and (daring or _is_sure(path))
    ]
    found += [
        (variable, path, True)
        for variable in c.primed
        for path, its_type in _paths(variable.type)
        if its_type == type_
    ]
    if not found:
        return None
    variable, path, primed = c.draft.pick(found)
    steps = tuple(_step(c, stage, depth) for stage in path)
    robot = _robot(c, variable) if c.in_property else None
    return core.Place(variable, steps, robot, primed, span=c.draft.span())


def writable(c: Context, wanted: Type | None, depth: int) -> core.Place | None:
    """A place that may be written here: of a type, or of any."""
    daring = c.draft.chance(c.draft.profile.faulty * 3)
    found = [
        (variable, path)
        for variable in c.writable
        if _may_write(c, variable)
        for path, its_type in _paths(variable.type)
        if (wanted is None or its_type == wanted) and (path or variable.home is not Home.ALLREAD)
        if daring or _is_sure(path) or (len(path) == 1 and path[0].way is Way.KEY)
    ]
    if not found:
        return None
    variable, path = c.draft.pick(found)
    steps = [_step(c, stage, depth) for stage in path]
    if variable.home is Home.ALLREAD:
        steps[0] = core.IndexStep(core.Pid(INT), path[0].type, span=c.draft.span())
    return core.Place(variable, tuple(steps), span=c.draft.span())


def writable_part(c: Context, variable: core.Variable, depth: int) -> core.Place:
    """A bound variable or a part of it."""
    daring = c.draft.chance(c.draft.profile.faulty * 3)
    path, _ = c.draft.pick([p for p in _paths(variable.type) if daring or _is_sure(p[0])])
    steps = tuple(_step(c, stage, depth) for stage in path)
    return core.Place(variable, steps, span=c.draft.span())


def growing(c: Context, depth: int) -> core.Place | None:
    """A place of a list or queue that may be written here."""
    types = [
        its_type
        for variable in c.writable
        if _may_write(c, variable)
        for path, its_type in _paths(variable.type)
        if isinstance(its_type, GrowingType) and (path or variable.home is not Home.ALLREAD)
    ]
    return writable(c, c.draft.pick(types), depth) if types else None


def _is_sure(path: Path) -> bool:
    """Whether the place is there whatever lists and maps hold."""
    return all(
        stage.way is Way.FIELD or (stage.way is Way.INDEX and isinstance(stage.above, ArrayType))
        for stage in path
    )


def _may_write(c: Context, variable: core.Variable) -> bool:
    """Inside an atomic block, the allwrite variables of its class only."""
    if variable.home is not Home.ALLWRITE or c.atomic is None:
        return True
    return c.classes.get(variable.slot) == c.atomic


def _is_in_reach(c: Context, variable: core.Variable) -> bool:
    """In a property, locals and ports are those of some robot that is named."""
    if not c.in_property or variable.home not in (Home.LOCAL, Home.PORT):
        return True
    return bool(c.robots)


def _robot(c: Context, variable: core.Variable) -> core.Expr | None:
    if variable.home not in (Home.LOCAL, Home.PORT):
        return None
    kind = c.kinds.get((variable.home, variable.name))
    suitable = [bound for bound, agent in c.robots if agent == kind or kind is None]
    if not suitable or c.draft.chance(c.draft.profile.faulty / 2):
        suitable = [bound for bound, _ in c.robots]
    place = core.Place(c.draft.pick(suitable), span=c.draft.span())
    return core.Read(place, span=c.draft.span())


def _step(c: Context, stage: Stage, depth: int) -> core.Step:
    span = c.draft.span()
    match stage.way:
        case Way.FIELD:
            return core.FieldStep(stage.position, f"field{stage.position}", stage.type, span=span)
        case Way.INDEX:
            return core.IndexStep(index(c, stage.above, depth), stage.type, span=span)
        case Way.KEY:
            return core.KeyStep(expressions.key(c, stage.above, depth), stage.type, span=span)


def index(c: Context, above: Type, depth: int) -> core.Expr:
    """An index into an array or list: mostly one that may well exist."""
    draft = c.draft
    if draft.chance(draft.profile.faulty):
        return expressions.expression(c, INT, depth - 1)
    if isinstance(above, ArrayType) and above.size is Robots.ALL:
        names: list[core.Expr] = [
            core.Read(core.Place(bound, span=draft.span()), span=draft.span())
            for bound, _ in c.robots
        ]
        if c.pid:
            names += [core.Pid(INT, span=draft.span())] * 2
        if names and not draft.profile.calculates:
            return draft.pick(names)
        return draft.pick([*names, core.Const(0, INT, span=draft.span())])
    if isinstance(above, ArrayType):
        assert isinstance(above.size, int)
        if depth > 0 and draft.profile.calculates and draft.chance(0.3):
            return _within(c, above.size, depth)
        return core.Const(draft.random.randrange(above.size), INT, span=draft.span())
    counters = [b for b in c.bound if b.type == INT and draft.profile.calculates]
    if counters and draft.chance(0.4):
        return core.Read(core.Place(draft.pick(counters), span=draft.span()), span=draft.span())
    return core.Const(draft.weighted([(6, 0), (2, 1), (1, 2)]), INT, span=draft.span())


def _within(c: Context, size: int, depth: int) -> core.Expr:
    """Some computed index that an array of that size has."""
    computed = expressions.expression(c, INT, depth - 1)
    limit = core.Const(size, INT, span=c.draft.span())
    return core.Binary(BinaryOp.MOD, computed, limit, INT, span=c.draft.span())
