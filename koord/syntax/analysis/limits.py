"""Limits on the cost of programs, and the diagnostics where one is exceeded.

Without these limits a short text could keep every tool busy for years, or take all memory there is:
a loop of a thousand million trips, an array of arrays of arrays, sixty functions that call each
other twice. What passes is handled without overflow, and can be interrupted at any time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.work import (
    MOST_DEEP,
    MOST_NODES,
    MOST_STEPS,
    TooLargeError,
    TypeSizes,
    WorkEstimate,
)
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.source import Span
from koord.syntax.types import Type

#: Parts of all variables of a run together.
MOST_PARTS = 1_000_000

#: Types are made of types so deep.
DEEPEST_TYPE = 40


def excesses(program: core.Program, kinds: Sequence[int]) -> tuple[Diagnostic, ...]:
    """Diagnostics of the limits that a program exceeds for robots of these kinds, if any."""
    sizes = TypeSizes(len(kinds))
    found = tuple(_of_types(_declared(program), kinds, sizes))
    found = found or tuple(_of_storage(program, kinds, sizes))
    if found:
        return found
    try:
        ledger = WorkEstimate(program, tuple(kinds), sizes)
        found = tuple(_of_bodies(program, ledger))
        return tuple(_of_types(_bound(ledger), kinds, sizes)) or found
    except TooLargeError:
        told = f"the program has more than {MOST_NODES:,} places, with all that its records are"
        return (_error("K247", program.span, told, "make it of smaller parts"),)


# --- storage ------------------------------------------------------------------------------------


class _Holding(Struct, frozen=True):
    """The storage of a declaration, in a run of so many robots."""

    declaration: core.Declaration
    copies: int
    parts: int  #: of one copy

    @property
    def name(self) -> str:
        return self.declaration.variable.name


def _of_types(
    typed: Iterable[tuple[Type, str, Span]], kinds: Sequence[int], sizes: TypeSizes
) -> Iterator[Diagnostic]:
    """Yield the declarations whose values are too large by themselves."""
    for type_, what, span in typed:
        size = sizes.of(type_)
        if size.depth > DEEPEST_TYPE:
            yield _error(
                "K249",
                span,
                f"{what} is made of records and lists {size.depth} deep; "
                f"{DEEPEST_TYPE} is the most",
                "let fewer records hold each other",
            )
        elif size.parts > MOST_PARTS:
            yield _error(
                "K248",
                span,
                f"{what} has {count(size.parts)} parts{_with(kinds)}; all variables together have "
                f"{MOST_PARTS:,} at most",
                "make the arrays smaller, or use a list, which grows as it is needed",
            )


def _of_storage(
    program: core.Program, kinds: Sequence[int], sizes: TypeSizes
) -> Iterator[Diagnostic]:
    """Yield the declarations that are too large all together."""
    holdings = list(_holdings(program, kinds, sizes))
    total = sum(holding.copies * holding.parts for holding in holdings)
    if total <= MOST_PARTS:
        return
    largest = max(holdings, key=lambda holding: holding.copies * holding.parts)
    each = f", for each of {largest.copies:,} robots" if largest.copies > 1 else ""
    starts = ""
    if largest.declaration.length is not None:
        length = count(largest.declaration.length)
        starts = f" (an assumption gives it the length {length})"
    yield _error(
        "K248",
        largest.declaration.span,
        f"the variables of a run have {count(total)} parts{_with(kinds)}, of which "
        f"`{largest.name}`{starts} has {count(largest.parts)}{each}; {MOST_PARTS:,} is the most",
        "make arrays and lists shorter" + (", or take fewer robots" if len(kinds) > 1 else ""),
    )


def _holdings(program: core.Program, kinds: Sequence[int], sizes: TypeSizes) -> Iterator[_Holding]:
    for declaration in program.allwrite:
        yield _Holding(declaration, 1, _held(declaration, sizes))
    for declaration in program.allread:
        # The type is that of all entries; a length is that of each.
        yield _Holding(declaration, 1, _held(declaration, sizes))
    often = Counter(kinds)
    for kind, agent in enumerate(program.agents):
        for declaration in (*agent.locals, *(port.declaration for port in agent.ports)):
            yield _Holding(declaration, often[kind], _held(declaration, sizes))


def _held(declaration: core.Declaration, sizes: TypeSizes) -> int:
    parts = sizes.of(declaration.variable.type).parts
    return parts * max(1, declaration.length if declaration.length is not None else 1)


def _declared(program: core.Program) -> Iterator[tuple[Type, str, Span]]:
    """Yield the types of all declarations."""
    shared = (*program.allread, *program.allwrite)
    own = [d for agent in program.agents for d in agent.locals]
    ports = [port.declaration for agent in program.agents for port in agent.ports]
    for declaration in (*shared, *own, *ports):
        yield declaration.variable.type, f"`{declaration.variable.name}`", declaration.span
    for external in program.externals:
        yield external.result.type, f"the answer of `{external.name}`", external.span
    signatures = [(f.parameters, f.span) for f in program.functions]
    signatures += [(f.parameters, f.span) for f in program.externals]
    for parameters, span in signatures:
        for parameter in parameters:
            yield parameter.type, f"the parameter `{parameter.name}`", span


def _bound(ledger: WorkEstimate) -> Iterator[tuple[Type, str, Span]]:
    """Yield the types of variables inside of bodies."""
    for variable, span in ledger.bound.values():
        yield variable.type, f"`{variable.name}`", span


# --- bodies -------------------------------------------------------------------------------------


class _Body(Struct, frozen=True):
    """A body: expressions and statements that a run evaluates as one."""

    what: str
    span: Span
    parts: tuple[core.Expr, ...] = ()
    block: core.Block = ()


def _of_bodies(program: core.Program, ledger: WorkEstimate) -> Iterator[Diagnostic]:
    """Yield diagnostics of bodies that take too long, or whose calls nest too deep.

    Of functions the first is told that is too much, and not all that call it.
    """
    for function in program.functions:
        own = function.span.file == program.span.file  # and not the library's
        if own and ledger.functions[function.name].is_too_much:
            body = _Body(f"the function `{function.name}`", function.span, block=function.body)
            yield from _of_body(body, ledger)
            return
    for body in _bodies(program):
        yield from _of_body(body, ledger)


def _of_body(body: _Body, ledger: WorkEstimate) -> Iterator[Diagnostic]:
    work, culprit = ledger.body(body.parts, body.block)
    span = culprit if culprit is not None else body.span
    if work.deep > MOST_DEEP:
        yield _error(
            "K249",
            span,
            f"{body.what} is {work.deep} deep, with the functions that it calls; "
            f"{MOST_DEEP} is the most",
            "let functions call fewer others one inside the other",
        )
    elif work.steps > MOST_STEPS:
        yield _error(
            "K247",
            span,
            f"{body.what} takes up to {count(work.steps)} steps{_with(ledger.kinds)}; "
            f"{MOST_STEPS:,} is the most",
            "loop over less, or do a part of it in each round"
            + (", or take fewer robots" if len(ledger.kinds) > 1 else ""),
        )


def _bodies(program: core.Program) -> Iterator[_Body]:
    """Yield every body that a run evaluates as one."""
    for declaration in (*program.allread, *program.allwrite):
        yield from _initial(declaration)
    for agent in program.agents:
        for declaration in (*agent.locals, *(port.declaration for port in agent.ports)):
            yield from _initial(declaration)
        if agent.init:
            yield _Body("`init:`", agent.init[0].span, block=agent.init)
        for event in agent.events:
            yield _Body(f"the event `{event.name}`", event.span, (event.guard,), event.effect)
        for module in agent.modules:
            if module.environment:
                place = module.environment[0].span
                yield _Body(f"the model of `{module.name}`", place, block=module.environment)
            for contract in module.contracts:
                parts = (*contract.requires, *contract.ensures)
                yield _Body(f"the contract `{contract.name}`", contract.span, parts)
    for assumption in program.assumptions:
        yield _Body("the assumption", assumption.span, (assumption.condition,))
    for stated in (*program.expectations, *program.properties):
        parts = (
            (stated.condition,) if stated.trigger is None else (stated.trigger, stated.condition)
        )
        yield _Body(f"`{stated.name}`", stated.span, parts)


def _initial(declaration: core.Declaration) -> Iterator[_Body]:
    if not isinstance(declaration.initial, core.Start):
        what = f"the initial value of `{declaration.variable.name}`"
        yield _Body(what, declaration.span, (declaration.initial,))


# --- words --------------------------------------------------------------------------------------


def count(number: int) -> str:
    """Print a count, rounded if it is large."""
    if number < 10**15:
        return f"{number:,}"
    return f"about 10^{len(str(number)) - 1}" if number.bit_length() < 10_000 else "over 10^3000"


def _with(kinds: Sequence[int]) -> str:
    return f" with {len(kinds):,} robots" if len(kinds) > 1 else ""


def _error(code: str, span: Span, message: str, hint: str) -> Diagnostic:
    return Diagnostic(code, Severity.ERROR, span, message, hint)
