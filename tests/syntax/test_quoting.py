"""What is quoted and printed is the expression that it was, once it is elaborated again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from koord.refinement.generating.palette import GENERAL
from koord.refinement.generating.programs import system
from koord.syntax import core
from koord.syntax.catalogue import of_programs
from koord.syntax.core import Direction
from koord.syntax.elaboration.library import library
from koord.syntax.load import load
from koord.syntax.printing.quoting import Quoting, print_number
from koord.syntax.source import Source
from koord.syntax.types import BOOL, ArrayType, EnumType, RecordType, Type, show, within
from koord.syntax.walk import nodes, rebuilt
from tests.loading import program_of

#: Robots of one kind, of which all have every variable.
ALIKE = replace(GENERAL, agents=(1, 1))

ROOT = Path(__file__).resolve().parents[2]

TEXTS = {
    **{p.stem: p.read_text("utf-8") for p in sorted((ROOT / "specs/examples").glob("*.krd"))},
    **{code: e.good for code, e in of_programs().items() if len(e.good) < 1000},
}


# --- programs of nothing but declarations and conditions ------------------------------------------


def expressions(program: core.Program) -> list[core.Expr]:
    """The guards of a program, then its statements."""
    guards = [event.guard for agent in program.agents for event in agent.events]
    stated = [p.condition for p in program.properties if p.each is None]
    found = [*guards, *(a.condition for a in program.assumptions), *stated]
    true = core.Const(True, BOOL)
    return [true if any(map(_is_empty, nodes(e))) else e for e in found]


def _is_empty(node: object) -> bool:
    """A list or map of nothing: where nothing around it says of what, no text has one."""
    empty = (core.MakeList, "items"), (core.MakeMap, "entries")
    return any(isinstance(node, kind) and not getattr(node, part) for kind, part in empty)


def restated(program: core.Program) -> str:
    """A program with the declarations of another, its guards and its statements, as quoted."""
    quoting = Quoting.of(program)
    found = expressions(program)
    lines = [*_types(program), *_functions(program)]
    for section, declared in (("allread", program.allread), ("allwrite", program.allwrite)):
        lines += _variables(section, [d.variable for d in declared])
    for agent in program.agents:
        own = [*_ports(agent), *_variables("local", [d.variable for d in agent.locals])]
        for event in agent.events:
            guard = quoting.text(found.pop(0))
            own += [f"{event.name}:", f"  pre: {guard}", "  eff: pass"]
        lines += [f"agent {agent.name}:", *(f"  {line}" for line in own)] if agent.name else own
    lines += [f"invariant: {quoting.text(e)}" for e in found]
    return "".join(f"{line}\n" for line in lines)


def _types(program: core.Program) -> Iterator[str]:
    made: dict[Type, None] = {}
    for node in nodes(program):
        if isinstance(type_ := getattr(node, "type", None), Type):
            made.update(dict.fromkeys(reversed(list(within(type_)))))
    for type_ in made:
        if isinstance(type_, EnumType):
            yield f"enum {type_.name}: {', '.join(type_.members)}"
        elif isinstance(type_, RecordType) and type_.name != "pos":
            yield f"def {type_.name}:"
            yield from (f"  {show(field)} {name}" for name, field in type_.fields)


def _functions(program: core.Program) -> Iterator[str]:
    functions: tuple[core.Function | core.External, ...] = (*program.functions, *program.externals)
    for f in functions:
        result = f.result.type if isinstance(f, core.External) else f.result
        if f.shown in library().functions or result is None:
            continue
        parameters = ", ".join(f"{show(v.type)} {v.name}" for v in f.parameters)
        yield f"def fun {f.name}({parameters}) -> {show(result)}: extern"


def _variables(section: str, variables: Sequence[core.Variable]) -> Iterator[str]:
    if variables:
        yield f"{section}:"
    for v in variables:
        type_ = v.type
        if section == "allread":
            assert isinstance(type_, ArrayType)
            yield f"  {show(type_.element)}[] {v.name}"
        else:
            yield f"  {show(type_)} {v.name}"


def _ports(agent: core.Agent) -> Iterator[str]:
    for module in agent.modules:
        yield f"using {module.name}:"
        for direction, head in ((Direction.SENSOR, "sensors"), (Direction.ACTUATOR, "actuators")):
            ports = [agent.ports[k] for k in module.ports]
            yield f"  {head}:"
            for port in (p for p in ports if p.direction is direction):
                variable = port.declaration.variable
                yield f"    {show(variable.type)} {variable.name}"


def renumbered(expression: core.Expr) -> core.Expr:
    """The expression with bound slots and calls numbered in the order of the text, ports not."""
    slots: dict[int, int] = {}

    def visit(node: Any) -> Any:
        match node:
            case core.Variable(home=core.Home.BOUND, slot=slot):
                return replace(node, slot=slots.setdefault(slot, len(slots)))
            case core.Variable():
                return replace(node, slot=0)
            case core.Call() | core.ExternalCall():
                called = core.ExternalCall(node.function, node.arguments, node.type, 0)
                return rebuilt(called, visit)
            case core.Choose():
                return rebuilt(replace(node, site=0), visit)
        return rebuilt(node, visit)

    found: core.Expr = visit(expression)
    return found


def assert_same(program: core.Program, other: core.Program) -> None:
    pairs = zip(expressions(program), expressions(other), strict=True)
    for one, another in pairs:
        assert renumbered(one) == renumbered(another)


@pytest.mark.parametrize("name", TEXTS)
def test_what_a_text_says_is_quoted_as_it_is(name: str) -> None:
    program = load(Source("app.krd", TEXTS[name])).program
    if program is not None:
        assert_same(program, program_of(restated(program)))


@pytest.mark.parametrize("seed", range(25))
def test_what_is_generated_is_quoted_as_it_is(seed: int) -> None:
    # What is generated is not always as elaboration leaves it: constants are folded there.
    once = program_of(restated(system(Random(seed), ALIKE).program))
    assert_same(once, program_of(restated(once)))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Fraction(3), "3"),
        (Fraction(-3), "-3"),
        (Fraction(1, 2), "0.5"),
        (Fraction(-1, 8), "-0.125"),
        (Fraction(1, 3), "1.0 / 3"),
    ],
)
def test_numbers_are_decimals_where_they_can_be(value: Fraction, text: str) -> None:
    assert print_number(value) == text
