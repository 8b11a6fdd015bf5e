"""Functions that merge two maps: how they are known, and which keys matter. [T-OBSERVE]"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import ListOp
from koord.syntax.types import MapType
from koord.syntax.walk import nodes

#: Of so many keys a summary speaks one by one.
_MOST_ASKED = 64


def merged(function: core.Function) -> MapType | None:
    """The type of the maps that a function merges, if it does nothing else.

    That is: it takes the entries of one over into another, where they overwrite what is there.
    """
    match function.body:
        case (
            core.Assign(
                place=core.Place(variable=both, steps=()),
                value=core.Read(place=core.Place(variable=old, steps=())),
            ),
            core.ForEach(
                key=key,
                value=value,
                sequence=core.Read(place=core.Place(variable=new, steps=())),
                body=(
                    core.Assign(
                        place=core.Place(
                            variable=into,
                            steps=(
                                core.KeyStep(
                                    key=core.Read(place=core.Place(variable=at, steps=()))
                                ),
                            ),
                        ),
                        value=core.Read(place=core.Place(variable=put, steps=())),
                    ),
                ),
            ),
            core.Return(value=core.Read(place=core.Place(variable=result, steps=()))),
        ) if (
            (old, new) == function.parameters
            and both.home is core.Home.BOUND
            and both not in function.parameters
            and (into, at, put, result) == (both, key, value, both)
            and both.type == old.type == new.type
            and isinstance(both.type, MapType)
        ):
            return both.type
        case _:
            return None


def asked_keys(program: core.Program, type_: MapType) -> range | None:
    """A range that all keys are in by which maps of a type are looked into; None: it is open.

    Solvers do without a quantifier then, which they seldom find models of.
    """
    ranges, is_open = _bounds_of_variables(program)
    found: list[range] = []
    for key in _keys_of(program, type_):
        match key:
            case core.Const(value=bool()):
                return None
            case core.Const(value=int(value)):
                found.append(range(value, value + 1))
            case core.Read(place=core.Place(variable=variable, steps=())) if (
                variable in ranges and variable not in is_open
            ):
                found += ranges[variable]
            case _:
                return None
    asked = [each for each in found if each]
    if not asked:
        return range(0)
    whole = range(min(each.start for each in asked), max(each.stop for each in asked))
    return whole if len(whole) <= _MOST_ASKED else None


def _keys_of(program: core.Program, type_: MapType) -> Iterator[core.Expr]:
    """The keys by which a program looks into maps of a type, but where it merges them."""
    summaries = tuple((e.requires, e.ensures) for e in program.externals)
    for node in nodes((without_summaries(program), summaries)):
        match node:
            case core.Place(variable=variable, steps=steps):
                bases = [variable.type, *(step.type for step in steps[:-1])]
                for base, step in zip(bases, steps, strict=False):
                    if base == type_ and isinstance(step, core.KeyStep):
                        yield step.key
            case core.Select(base=whole, step=core.KeyStep(key=key)) if whole.type == type_:
                yield key
            case core.Builtin(op=ListOp.CONTAINS, arguments=(whole, key)) if whole.type == type_:
                yield key
            case _:
                pass


def _bounds_of_variables(
    program: core.Program,
) -> tuple[dict[core.Variable, list[range]], set[core.Variable]]:
    """The ranges of bound variables whose ends the text says, and the other bound variables."""
    ranges: dict[core.Variable, list[range]] = {}
    is_open: set[core.Variable] = set()
    for node in nodes(program):
        match node:
            case (
                core.Quantified(
                    variable=variable,
                    domain=core.IntRange(low=core.Const(value=low), high=core.Const(value=high)),
                )
                | core.ForRange(
                    variable=variable, low=core.Const(value=low), high=core.Const(value=high)
                )
            ):
                assert isinstance(low, int)
                assert isinstance(high, int)
                ranges.setdefault(variable, []).append(range(low, high))
            case core.Quantified(variable=variable) | core.ForRange(variable=variable):
                is_open.add(variable)
            case core.ForEach(key=key, value=value):
                is_open |= {each for each in (key, value) if each is not None}
            case core.Function(parameters=parameters):
                is_open |= set(parameters)
            case core.External(parameters=parameters, result=result):
                is_open |= {*parameters, result}
            case core.Assign(place=core.Place(variable=variable)):
                is_open.add(variable)
            case core.Pop(into=core.Place(variable=variable)):
                is_open.add(variable)
            case core.Property(each=core.Each(variable=variable)):
                is_open.add(variable)
            case _:
                pass
    return ranges, is_open


def without_summaries(program: core.Program) -> core.Program:
    """The program without external functions, and without functions that merge maps."""
    functions = tuple(f for f in program.functions if merged(f) is None)
    return replace(program, functions=functions, externals=())
