"""Warnings: constructs that are allowed, but hardly intended."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from koord.syntax import ast, core
from koord.syntax.analysis.contradictions import contradicting
from koord.syntax.analysis.folding import constant
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Confusion, Elaboration
from koord.syntax.elaboration.symbols import Named, ParamSymbol, VariableSymbol
from koord.syntax.types import ArrayType, show
from koord.syntax.walk import nodes


def never_enabled(session: Elaboration, event: ast.Event, guard: core.Expr) -> None:
    """Warn of an event whose guard is false in every configuration."""
    if constant(guard) is False or contradicting([guard]) is not None:
        assert event.pre is not None
        session.findings.warning(
            "K402",
            event.pre.span,
            f"the event `{event.name.name}` is never enabled: its guard is always false",
        )


def lost_updates(body: BodyScope, guarded: frozenset[int], effect: core.Block) -> None:
    """Warn of allwrite variables that an event reads, and writes outside of `atomic`.

    ``guarded`` are those that its guard reads. There, a write that is the same for every robot (a
    flag that is taken back) is no matter of who comes first.
    """
    told: set[int] = set()
    differing = {s.place.span for s in nodes(effect) if isinstance(s, core.Assign) and _differs(s)}
    for write in body.writes:
        slot = write.variable.slot
        if write.block is not None or write.own or slot in told:
            continue
        if slot in body.shared_reads:
            read, cure = "read and written", "put both under `atomic:`"
        elif slot in guarded and write.span in differing:
            read, cure = "read in the guard and written", "put the write under `atomic:`"
        else:
            continue
        told.add(slot)
        body.findings.warning(
            "K401",
            write.span,
            f"`{write.variable.name}` is {read} outside `atomic`: "
            "of two robots that do so in one round, one loses its update",
            cure,
        )


def _differs(statement: core.Assign) -> bool:
    """Return whether two robots may write different values."""
    return any(isinstance(node, core.Place | core.Pid) for node in nodes(statement.value))


def contradictions(
    session: Elaboration,
    agents: Iterable[core.Agent],
    assumptions: Iterable[core.Assumption],
    externals: Iterable[core.External],
) -> None:
    """Warn of conditions that never hold, which make claims vacuous."""
    _never(session, [a.condition for a in assumptions], "this assumption", "nothing can begin")
    for agent in agents:
        for module in agent.modules:
            for contract in module.contracts:
                empty = "the contract promises nothing"
                _never(session, contract.requires, "this `requires:`", empty)
                kept = "no environment can keep it"
                _never(session, contract.ensures, "this `ensures:`", kept)
    for external in externals:
        _never(session, external.requires, "this `requires:`", "every call is a fault")
        _never(session, external.ensures, "this `ensures:`", "no function can keep it")


def _never(
    session: Elaboration, conditions: Sequence[core.Expr], what: str, consequence: str
) -> None:
    false = [condition for condition in conditions if constant(condition) is False]
    for condition in false:
        session.findings.warning("K404", condition.span, f"{what} is always false: {consequence}")
    part = contradicting(conditions) if not false else None
    if part is not None:
        story = f"{what} contradicts what is said before it: {consequence}"
        session.findings.warning("K404", part.span, story)


def unused(session: Elaboration, scopes: Iterable[dict[str, Named]]) -> None:
    """Warn of variables and params that are never used."""
    for scope in scopes:
        for name, symbol in scope.items():
            wrong = isinstance(symbol, ParamSymbol) and symbol.value is None
            if wrong or name in session.ambiguous or id(symbol.declared) in session.used:
                continue
            if isinstance(symbol, VariableSymbol | ParamSymbol):
                what = "param" if isinstance(symbol, ParamSymbol) else "variable"
                shadowed = name in session.loop_variables
                session.findings.warning(
                    "K403",
                    symbol.declared.span,
                    f"the {what} `{name}` is never used",
                    "a `for` loop declares its own variable: leave this one out"
                    if shadowed
                    else None,
                )


def confused(session: Elaboration) -> None:
    """Report allread variables whose entries were meant to be lists, each at its type."""
    for symbol in session.shared.values():
        if not isinstance(symbol, VariableSymbol):
            continue
        uses = [found for found in session.confusions if found.variable == symbol.variable]
        if uses:
            _confused(session, symbol, uses)


def _confused(session: Elaboration, symbol: VariableSymbol, uses: list[Confusion]) -> None:
    name = symbol.variable.name
    assert isinstance(symbol.variable.type, ArrayType)
    entry = show(symbol.variable.type.element)
    stored = [use for use in uses if use.stored] or uses
    verb = "is stored in" if stored[0].stored else "is wanted of"
    session.findings.error(
        "K244",
        symbol.type_span,
        f"`{name}` holds one `{entry}` for each robot, but a `{entry}[]` {verb} `{name}[pid]`",
        f"declare it as `{entry}[][] {name}`: one `{entry}[]` for each robot",
        tuple(
            Note(
                use.span,
                f"a `{entry}[]` is stored here" if use.stored else f"`{entry}[][]` is wanted here",
            )
            for use in sorted(uses, key=lambda use: (use.span.line, use.span.column))[:4]
        ),
    )
