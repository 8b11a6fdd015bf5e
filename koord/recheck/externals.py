"""Calls of external functions: unknown answers, of which summaries say something. [EXTERNAL]"""

from __future__ import annotations

from collections.abc import Sequence

from koord.recheck import quantifiers
from koord.recheck.body import RunningBody
from koord.recheck.sorts import NotRecheckedError, Value
from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.recheck.world import opened
from koord.syntax import core
from koord.syntax.types import GrowingType, MapType, Type, atoms, contains
from koord.syntax.walk import nodes


def answer(body: RunningBody, e: core.ExternalCall) -> Value:
    """Any answer that the summary allows; the same to the same question. [EXTERNAL]"""
    function = body.world.program.external(e.function)
    if any(contains(v.type, MapType) for v in (function.result, *function.parameters)):
        # What is supposed of all maps would be supposed of those that are none.
        raise NotRecheckedError("external functions of maps are not rechecked", e.span)
    arguments = [body.value(argument) for argument in e.arguments]
    pairs = list(zip(arguments, function.parameters, strict=True))
    result = function.result.type
    if function.kind is core.ExternalKind.FRESH:
        if body.closed:
            raise NotRecheckedError("a fresh answer in a property is not rechecked", e.span)
        found: Value = body.v.fresh(f"{function.name} by {who(body.robot)}", result)
    else:
        flat = [term for a, p in pairs for term, _ in body.v.leaves(a, p.type)]
        found = body.v.applied(function.name, flat, result)
    if body.in_summary:
        return found
    for term, type_ in body.v.leaves(found, result):
        for bound in body.v.bounds(term, type_):
            body.require(bound)
    met, promised = _summary(body, function, arguments, found)
    body.fault_unless(met, f"what {function.name} requires is not met", e.span)
    if not (function.kind is core.ExternalKind.FUNCTION and _promise_always(body, function)):
        body.require(body.t.implies(met, promised))
    return found


def _summary(
    body: RunningBody, function: core.External, arguments: Sequence[Value], answer: Value
) -> tuple[Term, Term]:
    """What a function requires, and what it promises of an answer."""
    outer, body.bound = (
        body.bound,
        [
            *(
                body.s.stored(a, p.type)
                for a, p in zip(arguments, function.parameters, strict=True)
            ),
            body.s.stored(answer, function.result.type),
            *[None] * (function.bound - len(arguments) - 1),
        ],
    )
    inside, body.in_summary = body.in_summary, True
    met = body.t.conjunction([body.statement(r) for r in function.requires])
    # A promise that looks into a sealed list is left out: that only makes proofs harder.
    kept = [q for q in function.ensures if not _looks_inside(body, q)]
    promised = body.t.conjunction([body.statement(q) for q in kept])
    body.in_summary, body.bound = inside, outer
    return met, promised


def _promise_always(asking: RunningBody, function: core.External) -> bool:
    """Suppose the summary of all questions at once, where any number of robots may ask.

    A mathematical function keeps it for all arguments, asked for or not. [EXTERNAL] Not where
    one is a list that is looked into: there it is supposed of each question.
    """
    v = asking.v
    if v.robots is not None or any(_is_long(p.type, v) for p in function.parameters):
        return False
    if function.name not in v.promised:
        v.promised.add(function.name)
        binders: list[Term] = []
        with v.scoped(()):
            body = asking.apart()
            names = [f"{function.name} {p.name}" for p in function.parameters]
            asked: list[Value] = [
                quantifiers.binder(body, name, p.type, binders)
                for name, p in zip(names, function.parameters, strict=True)
            ]
            flat = [
                term
                for a, p in zip(asked, function.parameters, strict=True)
                for term, _ in v.leaves(a, p.type)
            ]
            answer = v.applied(function.name, flat, function.result.type)
            met, promised = _summary(body, function, asked, answer)
            inside = [
                bound
                for a, p in zip(asked, function.parameters, strict=True)
                for term, type_ in v.leaves(a, p.type)
                for bound in v.bounds(term, type_)
            ]
            known = v.t.conjunction([met, *inside])
            v.ranges.append(v.t.for_all(binders, v.t.implies(known, promised)))
    return True


def _looks_inside(body: RunningBody, promise: core.Expr) -> bool:
    sealed = body.world.sealed
    return any(type_ in sealed for node in nodes(promise) for type_ in opened(node))


def _is_long(type_: Type, v: Values) -> bool:
    """Whether there are lists in a value that are sequences to the solver."""
    return any(isinstance(atom, GrowingType) and atom not in v.sealed for atom in atoms(type_))


def who(robot: Term | None) -> str:
    """Who runs, as a part of the name of an unknown."""
    return "a robot" if robot is None or robot.value is None else robot.head
