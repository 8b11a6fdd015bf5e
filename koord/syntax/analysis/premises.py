"""Premises of proofs: assumptions, contracts without a model, summaries."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.source import Span


class PremiseKind(Enum):
    """The kinds of premises."""

    ASSUMPTION = "assumption"  #: the start
    CONTRACT = "contract"  #: sensors
    SUMMARY = "summary"  #: an external function


class Premise(Struct, frozen=True):
    """A premise: a statement that proofs may use without proof.

    ``name`` is that of the assumption, of the contract with its module, or of the function;
    ``promise`` counts what a contract or summary ensures from 1, out of ``promises``.
    """

    kind: PremiseKind
    name: str
    span: Span
    promise: int = 1
    promises: int = 1


def premises(program: core.Program) -> tuple[Premise, ...]:
    """All premises of a program, in the order of its parts."""
    found = [Premise(PremiseKind.ASSUMPTION, a.name, a.span) for a in program.assumptions]
    for agent in program.agents:
        for module in agent.modules:
            found += [p for contract in module.contracts for p in promises_of(module, contract)]
    for external in program.externals:
        count = len(external.ensures)
        found += [
            Premise(PremiseKind.SUMMARY, external.name, external.span, k + 1, count)
            for k in range(count)
        ]
    return tuple(dict.fromkeys(found))


def promises_of(module: core.Module, contract: core.Contract) -> tuple[Premise, ...]:
    """The premises that a contract stands for: none if a model has to keep it."""
    if module.environment is not None:
        return ()
    name, count = f"{module.name}.{contract.name}", len(contract.ensures)
    return tuple(Premise(_CONTRACT, name, contract.span, k + 1, count) for k in range(count))


def without(program: core.Program, left_out: Sequence[Premise]) -> core.Program:
    """The program without some of its premises, which allows more runs."""

    def ensured(kind: PremiseKind, name: str, span: Span, all_: tuple[core.Expr, ...]) -> _Exprs:
        gone = {p.promise for p in left_out if (p.kind, p.name, p.span) == (kind, name, span)}
        return tuple(e for k, e in enumerate(all_, start=1) if k not in gone)

    def module(of: core.Module) -> core.Module:
        if of.environment is not None:
            return of
        contracts = tuple(
            replace(c, ensures=ensured(_CONTRACT, f"{of.name}.{c.name}", c.span, c.ensures))
            for c in of.contracts
        )
        return replace(of, contracts=contracts)

    gone = {(p.name, p.span) for p in left_out if p.kind is PremiseKind.ASSUMPTION}
    return replace(
        program,
        assumptions=tuple(a for a in program.assumptions if (a.name, a.span) not in gone),
        agents=tuple(replace(a, modules=tuple(map(module, a.modules))) for a in program.agents),
        externals=tuple(
            replace(e, ensures=ensured(PremiseKind.SUMMARY, e.name, e.span, e.ensures))
            for e in program.externals
        ),
    )


_Exprs = tuple[core.Expr, ...]
_CONTRACT = PremiseKind.CONTRACT
