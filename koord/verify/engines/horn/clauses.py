"""Constrained Horn clauses over one relation: the reachable states.

Spacer, which Z3 brings, looks for an interpretation of the relation that keeps a claim, or for a
run that breaks it. See Komuravelli, Gurfinkel, Chaki, *SMT-based model checking for recursive
programs* (2014).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeAlias

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.every_number import NotFiniteError
from koord.semantics.storage import Many, Storage, Tree
from koord.semantics.values import Family, Rec, Seq, Table, Value
from koord.syntax.core import BinaryOp
from koord.syntax.source import NOWHERE
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.terms import Term, Terms, parts_of
from koord.verify.encoding.z3_builder import spent_by
from koord.verify.encoding.z3_loading import z3


def scalars(configuration: Configuration[Term]) -> list[Term]:
    """The scalars of a configuration, in a fixed order per system.

    Raises NotFiniteError where there are lists or maps that may be of any size.
    """
    found: list[Term] = []
    for robot in configuration.robots:
        found += [robot.status, robot.ran]
        for storage in (*robot.locals, *robot.ports):
            found += _of_storage(storage)
    for storage in (*configuration.store.allread, *configuration.store.allwrite):
        found += _of_storage(storage)
    return found


def _of_storage(storage: Storage[Term]) -> Iterator[Term]:
    if isinstance(storage, Many):
        raise AssertionError("systems of so many robots have no families")
    if isinstance(storage, Tree):
        for part in storage.parts:
            yield from _of_storage(part)
    else:
        yield storage.is_set
        yield from _of_value(storage.value)


def _of_value(value: Value[Term]) -> Iterator[Term]:
    if isinstance(value, Rec):
        for part in value.fields:
            yield from _of_value(part)
    elif isinstance(value, Seq):
        if not isinstance(value.length, int):
            raise NotFiniteError(NOWHERE, "a list may have any length")
        yield value.length
        for part in value.items:
            yield from _of_value(part)
    elif isinstance(value, Table):
        raise NotFiniteError(NOWHERE, "a map may have any size")
    elif isinstance(value, Family):
        raise AssertionError("systems of so many robots have no families")
    else:
        yield value


#: The values of a state's unknowns, in order.
State: TypeAlias = "tuple[Constant, ...]"


class Safe(Struct, frozen=True):
    """The result that no bad state is reachable: ``kept`` is an invariant over the unknowns."""

    kept: Term


class Reached(Struct, frozen=True):
    """The result that a bad state is reachable: by these states, from INIT on."""

    states: tuple[State, ...]


class Clauses:
    """The clauses of one system. ``unknowns`` are the constants that make up a state.

    Everything else in a clause is new in each use of it.
    """

    def __init__(self, d: Terms, unknowns: Sequence[Term]) -> None:
        self.d = d
        self.unknowns = unknowns
        self._rules: list[tuple[str, z3.ExprRef, z3.BoolRef]] = []
        truth = z3.BoolSort(self.d.context)
        sorts = [unknown.sort() for unknown in self._state]
        self._relation: z3.FuncDeclRef = z3.Function("reached", *sorts, truth)
        self._bad: z3.FuncDeclRef = z3.Function(_BAD, truth)

    @property
    def _state(self) -> list[z3.ExprRef]:
        return [x for x in self.unknowns if isinstance(x, z3.ExprRef)]

    @property
    def here(self) -> Term:
        """The relation applied to the unknowns: their state is reachable."""
        return self._of(self.unknowns)

    def reach(self, body: Iterable[Term], values: Sequence[Term]) -> None:
        """Add a clause: where the body holds, the state with these values is reachable."""
        self._rules.append(("reach", self._of(values), self._all(body)))

    def spoil(self, body: Iterable[Term]) -> None:
        """Add a clause: where the body holds, a bad state is reachable."""
        head = self._bad()
        assert isinstance(head, z3.ExprRef)
        self._rules.append((_BAD, head, self._all(body)))

    def solved(self, deadline: Deadline, effort: Effort, seed: int) -> Safe | Reached | None:
        """Decide whether a bad state is reachable; None if the solver does not finish."""
        if effort.left <= 0:
            return None
        if all(name != _BAD for name, _, _ in self._rules):
            return Safe(True)
        search = z3.Fixedpoint(ctx=self.d.context)
        search.set("engine", "spacer")
        search.set("spacer.random_seed", seed)
        limit = min(effort.left, _MOST)
        search.set("rlimit", limit)
        left = deadline.left_s()
        if left is not None:
            search.set("timeout", max(1, int(left * 1000)))
        for transformation in _UNWANTED:
            search.set(transformation, False)
        search.register_relation(self._relation, self._bad)
        search.declare_var(*self._constants())
        for name, head, body in self._rules:
            search.rule(head, [body], name=name)
        try:
            # As a formula: asked about relations Z3 does not hear Ctrl-C.
            found = search.query(self._bad())
            why = search.reason_unknown() if found == z3.unknown else ""
        except z3.Z3Exception as error:
            found, why = z3.unknown, _message(error)
            if _CANCELED not in why and _AT_LIMIT not in why:
                raise NotFiniteError(NOWHERE, f"Spacer cannot be asked: {why}") from error
        spent = spent_by(search)
        effort.left -= spent
        if _CANCELED in why and spent < limit and not deadline.is_near():
            raise KeyboardInterrupt
        if found == z3.unsat:
            return self._safe(search.get_answer())
        if found == z3.sat:
            states = tuple(self._facts(search.get_answer()))
            return Reached(states)
        return None

    def equations(self, values: Iterable[Term], state: State) -> list[Term]:
        """The equations of the first unknowns with their values in a state."""
        triples = zip(values, self._state, state, strict=False)
        return [
            self.d.binary(BinaryOp.EQ, self.d.lifted(value, x.sort()), known)
            for value, x, known in triples
        ]

    # --- making clauses -------------------------------------------------------------------------

    def _of(self, values: Sequence[Term]) -> z3.ExprRef:
        pairs = zip(values, self._state, strict=True)
        applied = self._relation(*(self.d.lifted(value, x.sort()) for value, x in pairs))
        assert isinstance(applied, z3.ExprRef)
        return applied

    def _all(self, body: Iterable[Term]) -> z3.BoolRef:
        parts = [self.d.boolean(part) for part in body if self.d.known(part) is not True]
        both = z3.And(*parts, z3.BoolVal(True, self.d.context))
        assert isinstance(both, z3.BoolRef)
        return both

    def _constants(self) -> list[z3.ExprRef]:
        own = {self._relation.name(), self._bad.name()}
        rules = [term for _, head, body in self._rules for term in (head, body)]
        found = {x.get_id(): x for x in (*self._state, *constants(rules, own))}
        return list(found.values())

    def impossible(self, body: Iterable[Term], deadline: Deadline, effort: Effort) -> bool:
        """Return whether a body is unsatisfiable, by a solver independent of Spacer."""
        solver = z3.Solver(ctx=self.d.context)
        solver.set("rlimit", min(effort.left, _MOST))
        left = deadline.left_s()
        if left is not None:
            solver.set("timeout", max(1, int(left * 1000)))
        solver.add(self._all(body))
        return bool(solver.check() == z3.unsat)

    # --- reading answers ------------------------------------------------------------------------

    def _safe(self, answer: z3.ExprRef) -> Safe:
        """The formula that an answer gives for the relation, or None."""
        for part in answer.children() if z3.is_and(answer) else [answer]:
            if not z3.is_quantifier(part):
                continue
            said = part.body()
            if said.num_args() == 2 and said.arg(0).decl().eq(self._relation):
                # Bound variables count from the innermost: the last argument of the relation.
                order = {z3.get_var_index(x): k for k, x in enumerate(said.arg(0).children())}
                values = [self._state[order[k]] for k in range(len(order))]
                return Safe(z3.substitute_vars(said.arg(1), *values))
        return Safe(True)

    def _facts(self, proof: z3.ExprRef) -> Iterator[State]:
        """The states in a refutation, from INIT on."""
        facts = []
        waiting, seen = [proof], set[int]()
        while waiting:
            step = waiting.pop()
            if step.get_id() in seen or not _is_proof(step):
                continue
            seen.add(step.get_id())
            fact = step.arg(step.num_args() - 1)
            resolved = step.decl().kind() == z3.Z3_OP_PR_HYPER_RESOLVE
            if resolved and z3.is_app(fact) and fact.decl().eq(self._relation):
                facts.append(fact)
            waiting += step.children()
        for fact in reversed(facts):
            yield tuple(self.d.constant(x) for x in fact.children())


def constants(terms: Iterable[Term], but: Iterable[str] = ()) -> list[z3.ExprRef]:
    """The constants in some terms, except those with given names.

    Raises NotFiniteError for what Spacer knows nothing of.
    """
    found: dict[int, z3.ExprRef] = {}
    left_out = set(but)
    for part in parts_of(term for term in terms if isinstance(term, z3.ExprRef)):
        if z3.is_quantifier(part):
            raise NotFiniteError(NOWHERE, "summaries speak of all values of a type")
        if not z3.is_app(part) or part.decl().kind() != z3.Z3_OP_UNINTERPRETED:
            continue
        if part.decl().name() in left_out:
            continue
        if part.num_args():
            raise NotFiniteError(NOWHERE, f"functions like {part.decl().name()} may be anything")
        if part.sort().kind() not in _KNOWN_SORTS:
            raise NotFiniteError(NOWHERE, f"values of type {part.sort()} are opaque")
        found[part.get_id()] = part
    return list(found.values())


def _message(error: z3.Z3Exception) -> str:
    """The message of a Z3 exception, which may be bytes."""
    said = error.value
    return said.decode("utf-8", "replace") if isinstance(said, bytes) else str(said)


def _is_proof(step: z3.ExprRef) -> bool:
    return bool(z3.is_app(step) and 0 <= step.decl().kind() - z3.Z3_OP_PR_UNDEF < _PROOF_RULES)


_BAD = "bad"

#: What Z3 says if it was stopped: by Ctrl-C, a limit or a time.
_CANCELED = "canceled"

#: What it says of a limit while it simplifies a question.
_AT_LIMIT = "max. resource limit exceeded"

#: Sorts that Spacer knows what to do with.
_KNOWN_SORTS = frozenset({z3.Z3_BOOL_SORT, z3.Z3_INT_SORT, z3.Z3_REAL_SORT})

#: What would make states disappear from refutations.
_UNWANTED = ("xform.inline_eager", "xform.inline_linear", "xform.slice")

#: So many kinds of operators are set aside for steps of proofs.
_PROOF_RULES = 0x100

#: Z3 takes no greater limit.
_MOST = 2**32 - 1
