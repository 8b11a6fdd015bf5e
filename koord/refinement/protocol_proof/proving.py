"""Z3 as the judge of the proof: each action keeps each statement, and the claims follow."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import product
from typing import assert_never

import z3

from koord.refinement.protocol_proof.invariant import CLAIMS, GUIDES, INVARIANT, SHY, Guide
from koord.refinement.protocol_proof.logic import (
    Action,
    And,
    Atom,
    Equal,
    Exists,
    ForAll,
    Formula,
    Not,
    Or,
    Relation,
    Sort,
    Statement,
    Variable,
    free,
    relations,
)
from koord.refinement.protocol_proof.model import (
    ACTIONS,
    AXIOMS,
    CHILD,
    CONSTANTS,
    PARENT,
    START,
    STATE,
    acknowledged,
    c,
    decides,
    earlier,
    h,
    k,
    left,
    p,
    parent,
)
from koord.refinement.protocol_proof.steps import Answer, Step

Terms = Mapping[Variable, z3.ExprRef]


class Prover:
    """The steps of the proof; ``timeout_s`` is that of one step."""

    def __init__(self, timeout_s: float = 60.0) -> None:
        self._timeout_ms = int(1000 * timeout_s)
        self._context = z3.Context()
        self._sorts = {sort: z3.DeclareSort(sort.value, self._context) for sort in Sort}
        self._constants = {one: self._constant(one.name, one.sort) for one in CONSTANTS}
        self._known: dict[str, z3.BoolRef] = {}
        self._bound = 0

    def steps(self) -> Iterator[Step]:
        """Work out all steps, in their order."""
        yield majorities_meet()
        for action in (START, *ACTIONS):
            for goal in INVARIANT:
                yield self.kept(action, goal)
        for goal in CLAIMS:
            yield self.follows(goal)

    def kept(self, action: Action, goal: Statement) -> Step:
        """Ask whether an action keeps a statement, all others being true before it."""
        guide = GUIDES.get((action.name, goal.name), Guide())
        parameters = {one: self._constant(one.name, one.sort) for one in action.parameters}
        step = _After(self, action, {**self._constants, **parameters})
        assumed = [
            self._closed(one.formula, step) for one in _named((*INVARIANT, *CLAIMS), guide.after)
        ]
        assumed += [self.term(one, step.terms) for one in action.guard]
        if action is START:
            known: list[Statement] = []
        else:
            known = _known(goal, guide)
        return self._asked(action.name, action.rule, goal, known, guide, assumed, step)

    def follows(self, goal: Statement) -> Step:
        """Ask whether a claim follows from the invariant and the claims before it."""
        guide = GUIDES.get(("", goal.name), Guide())
        return self._asked("", "", goal, _known(None, guide), guide, [], None)

    def _asked(
        self,
        action: str,
        rule: str,
        goal: Statement,
        known: Sequence[Statement],
        guide: Guide,
        assumed: list[z3.BoolRef],
        step: _After | None,
    ) -> Step:
        began = time.perf_counter()
        solver = z3.Solver(ctx=self._context)
        solver.set("timeout", self._timeout_ms)
        solver.set("auto_config", False)  # which would weigh instances anew
        for one in (*AXIOMS, *known):
            solver.add(self._before(one))
        solver.add(*assumed)
        terms = dict(self._constants)
        for variable in free(goal.formula):
            if variable not in self._constants:
                terms[variable] = self._constant(f"{variable.name}'", variable.sort)
        solver.add(z3.Not(self.term(goal.formula, terms, step)))
        for instance in self._instances(guide):
            solver.add(instance)
        answer = solver.check()
        took = time.perf_counter() - began
        if answer == z3.unsat:
            return Step(action, rule, goal.name, Answer.PROVED, took)
        if answer == z3.sat:
            lines = tuple(_facts(solver.model(), {*_SHOWN, *relations(goal.formula)}))
            return Step(action, rule, goal.name, Answer.REFUTED, took, lines)
        return Step(action, rule, goal.name, Answer.UNKNOWN, took)

    def _instances(self, guide: Guide) -> Iterator[z3.BoolRef]:
        """The histories that a guide speaks of exist."""
        for name in guide.parents:
            terms = {h: self._history(name), p: self._history(f"{name} less one")}
            yield self.term(PARENT, {**self._constants, **terms})
        for low, high in guide.children:
            child = f"{low} to {high}"
            terms = {c: self._history(low), k: self._history(child), h: self._history(high)}
            yield self.term(CHILD, {**self._constants, **terms})

    # --- terms ----------------------------------------------------------------------------------

    def _constant(self, name: str, sort: Sort) -> z3.ExprRef:
        return z3.Const(name, self._sorts[sort])

    def _history(self, name: str) -> z3.ExprRef:
        return self._constant(name, Sort.HISTORY)

    def _before(self, one: Statement) -> z3.BoolRef:
        """A statement of the state before an action."""
        if one.name not in self._known:
            self._known[one.name] = self._closed(one.formula, None)
        return self._known[one.name]

    def _closed(self, formula: Formula, step: _After | None) -> z3.BoolRef:
        variables = dict.fromkeys(one for one in free(formula) if one not in self._constants)
        closed = ForAll(tuple(variables), formula) if variables else formula
        return self.term(closed, self._constants, step)

    def term(self, formula: Formula, terms: Terms, step: _After | None = None) -> z3.BoolRef:
        """A formula as a term of Z3; with a ``step``, of the state after it."""
        match formula:
            case Atom():
                arguments = [terms[one] for one in formula.arguments]
                sorts = [self._sorts[sort] for sort in formula.relation.sorts]
                symbol = z3.Function(formula.relation.name, *sorts, z3.BoolSort(self._context))
                before = symbol(*arguments)
                return before if step is None else step.after(formula, before, arguments)
            case Equal(left=left, right=right):
                return terms[left] == terms[right]
            case Not(body=body):
                return z3.Not(self.term(body, terms, step))
            case And(parts=parts):
                return z3.And([self.term(one, terms, step) for one in parts])
            case Or(parts=parts):
                return z3.Or([self.term(one, terms, step) for one in parts])
            case ForAll(variables=variables, body=body):
                inner = self._fresh(variables)
                return z3.ForAll([*inner.values()], self.term(body, {**terms, **inner}, step))
            case Exists(variables=variables, body=body):
                inner = self._fresh(variables)
                return z3.Exists([*inner.values()], self.term(body, {**terms, **inner}, step))
            case _:
                assert_never(formula)

    def _fresh(self, variables: Sequence[Variable]) -> dict[Variable, z3.ExprRef]:
        self._bound += 1
        return {one: self._constant(f"{one.name}!{self._bound}", one.sort) for one in variables}


class _After:
    """The state after an action, told in terms of the state before."""

    def __init__(self, prover: Prover, action: Action, terms: Terms) -> None:
        self._prover = prover
        self._action = action
        self.terms = terms

    def after(self, atom: Atom, before: z3.BoolRef, arguments: Sequence[z3.ExprRef]) -> z3.BoolRef:
        """What an atom is after the action."""
        if atom.relation not in STATE:
            return before
        ways = [] if self._action is START else [before]
        for effect in self._action.effects:
            if effect.relation == atom.relation:
                terms = {**self.terms, **dict(zip(effect.variables, arguments, strict=True))}
                ways.append(self._prover.term(effect.where, terms))
        return z3.Or(ways) if ways else z3.BoolVal(False, before.ctx)


#: Relations that a counterexample tells of besides those of its statement.
_SHOWN = (earlier, parent, acknowledged, decides, left)

#: Relations of more elements would take seconds to list.
_MOST_SHOWN = 4


def _named(statements: Sequence[Statement], names: Sequence[str]) -> list[Statement]:
    found = {one.name: one for one in statements}
    return [found[name] for name in names]


def _known(goal: Statement | None, guide: Guide) -> list[Statement]:
    """What a step of the proof starts from."""
    if guide.only:
        used = _named(INVARIANT, guide.only)
    else:
        used = [
            one
            for one in INVARIANT
            if one.name not in SHY or one.name in guide.besides or one is goal
        ]
    return [*used, *_named(CLAIMS, guide.claims)]


def majorities_meet() -> Step:
    """Two majorities of a roster have a life in common, whatever the number of robots is.

    The axiom of the model, in numbers: of N lives, ``first`` and ``second`` are in two sets of at
    least ⌊N/2⌋ + 1, ``both`` in both.
    """
    began = time.perf_counter()
    context = z3.Context()
    robots, first, second, common = z3.Ints("robots first second both", context)
    solver = z3.Solver(ctx=context)
    solver.add(robots >= 1, first >= robots / 2 + 1, second >= robots / 2 + 1)
    solver.add(first + second - common <= robots, common < 1)
    answer = Answer.PROVED if solver.check() == z3.unsat else Answer.REFUTED
    took = time.perf_counter() - began
    return Step("majority", "R-MAJORITY", "majorities meet", answer, took)


def _facts(model: z3.ModelRef, shown: Set[Relation]) -> Iterator[str]:
    """The facts of a counterexample, a line each: what the variables are, and what is so before."""
    names: dict[str, str] = {}
    symbols = sorted(model.decls(), key=lambda symbol: str(symbol.name()))
    for symbol in symbols:
        if symbol.arity() == 0:
            element = str(model[symbol])
            names.setdefault(element, str(symbol.name()))
            if names[element] != str(symbol.name()):
                yield f"{symbol.name()} = {names[element]}"
    wanted = {one.name for one in shown}
    for symbol in symbols:
        if 0 < symbol.arity() <= _MOST_SHOWN and symbol.name() in wanted:
            found = list(_true_of(model, symbol, names))
            yield f"{symbol.name()}: {', '.join(found) or 'nothing'}"


def _true_of(model: z3.ModelRef, symbol: z3.FuncDeclRef, names: Mapping[str, str]) -> Iterator[str]:
    """The named elements of which a relation is true."""
    universes = [model.get_universe(symbol.domain(n)) or [] for n in range(symbol.arity())]
    domains = [[one for one in universe if str(one) in names] for universe in universes]
    for elements in product(*domains):
        if z3.is_true(model.eval(symbol(*elements))):
            yield f"({', '.join(names[str(one)] for one in elements)})"
