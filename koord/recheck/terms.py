"""Terms of SMT-LIB 2, hash-consed, with constants folded.

A term is known by identity: the same term made twice is the same object. Constants are folded, so
whatever does not depend on an unknown never reaches the solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction

from msgspec import Struct, field

INT, REAL, BOOL = "Int", "Real", "Bool"

Literal = int | Fraction | bool


class Term(Struct, frozen=True, eq=False):
    """A term: ``(head args…)``, or ``head`` alone. ``value`` is set for literals.

    A quantifier has its bound variables in ``binders``.
    """

    head: str
    args: tuple[Term, ...]
    sort: str
    value: Literal | None = None
    binders: tuple[Term, ...] = ()


def quoted(name: str) -> str:
    """Quote any text as a symbol of SMT-LIB."""
    return "|" + name.replace("|", "!").replace("\\", "!") + "|"


def subterms(terms: Iterable[Term]) -> Iterator[Term]:
    """Yield terms and all below them, each once."""
    seen: set[int] = set()
    pending = list(terms)
    while pending:
        term = pending.pop()
        if id(term) not in seen:
            seen.add(id(term))
            yield term
            pending += term.args


class Terms(Struct):
    """A builder of terms; one instance per script."""

    _known: dict[tuple[object, ...], Term] = field(default_factory=dict)
    _free: dict[int, frozenset[str]] = field(default_factory=dict)
    _put: dict[tuple[int, int], dict[int, Term]] = field(default_factory=dict)
    _blanks: int = 0

    def _make(
        self,
        head: str,
        args: tuple[Term, ...],
        sort: str,
        value: Literal | None = None,
        binders: tuple[Term, ...] = (),
    ) -> Term:
        # Terms are kept alive by this table, so their ids are names.
        key = (head, sort, *(id(a) for a in args), "", *(id(b) for b in binders))
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = Term(head, args, sort, value, binders)
        return found

    # --- leaves ---------------------------------------------------------------------------------

    def symbol(self, name: str, sort: str) -> Term:
        return self._make(quoted(name), (), sort)

    def truth(self, value: bool) -> Term:
        return self._make("true" if value else "false", (), BOOL, value)

    def integer(self, value: int) -> Term:
        text = str(value) if value >= 0 else f"(- {-value})"
        return self._make(text, (), INT, value)

    def real(self, value: Fraction) -> Term:
        top = f"{abs(value.numerator)}.0"
        text = top if value.denominator == 1 else f"(/ {top} {value.denominator}.0)"
        return self._make(text if value >= 0 else f"(- {text})", (), REAL, value)

    def _number(self, value: int | Fraction, sort: str) -> Term:
        return self.integer(int(value)) if sort == INT else self.real(Fraction(value))

    def op(self, head: str, args: Sequence[Term], sort: str) -> Term:
        """Apply an operation that is not interpreted here."""
        return self._make(head, tuple(args), sort)

    # --- Booleans -------------------------------------------------------------------------------

    def negation(self, a: Term) -> Term:
        if a.value is not None:
            return self.truth(not a.value)
        return a.args[0] if a.head == "not" else self._make("not", (a,), BOOL)

    def conjunction(self, parts: Iterable[Term]) -> Term:
        return self._many("and", parts, neutral=True)

    def disjunction(self, parts: Iterable[Term]) -> Term:
        return self._many("or", parts, neutral=False)

    def _many(self, head: str, parts: Iterable[Term], *, neutral: bool) -> Term:
        kept: dict[int, Term] = {}
        for part in parts:
            for p in part.args if part.head == head else (part,):
                if p.value is not None:
                    if p.value is not neutral:
                        return self.truth(not neutral)
                    continue
                if id(self.negation(p)) in kept:
                    return self.truth(not neutral)
                kept[id(p)] = p
        if not kept:
            return self.truth(neutral)
        left = tuple(kept.values())
        return left[0] if len(left) == 1 else self._make(head, left, BOOL)

    def both(self, a: Term, b: Term) -> Term:
        return self.conjunction((a, b))

    def either(self, a: Term, b: Term) -> Term:
        return self.disjunction((a, b))

    def implies(self, a: Term, b: Term) -> Term:
        return self.disjunction((self.negation(a), b))

    def ite(self, condition: Term, then: Term, other: Term) -> Term:
        if condition.value is not None:
            return then if condition.value else other
        if then is other:
            return then
        if then.sort == BOOL:
            if then.value is not None:
                known = self.either if then.value else self._unless
                return known(condition, other)
            if other.value is not None:
                return self.implies(condition, then) if other.value else self.both(condition, then)
        return self._make("ite", (condition, then, other), then.sort)

    def _unless(self, condition: Term, other: Term) -> Term:
        return self.both(self.negation(condition), other)

    def equal(self, a: Term, b: Term) -> Term:
        if a is b:
            return self.truth(True)
        if a.value is not None and b.value is not None:
            return self.truth(a.value == b.value)
        if a.sort == BOOL:
            for one, other in ((a, b), (b, a)):
                if one.value is not None:
                    return other if one.value else self.negation(other)
        return self._make("=", (a, b), BOOL)

    def for_all(self, binders: Sequence[Term], body: Term) -> Term:
        """A universal quantifier, without binders that the body does not mention."""
        free = self.free(body)
        kept = tuple(b for b in binders if b.head in free)
        if not kept or body.value is not None:
            return body
        if body.binders and not {b.head for b in kept} & {b.head for b in body.binders}:
            return self._make("forall", body.args, BOOL, None, (*kept, *body.binders))
        return self._make("forall", (body,), BOOL, None, kept)

    def exists(self, binders: Sequence[Term], body: Term) -> Term:
        return self.negation(self.for_all(binders, self.negation(body)))

    # --- variables of quantifiers ---------------------------------------------------------------

    def bound(self, level: int, sort: str = INT) -> Term:
        """The bound variable of a quantifier at a nesting depth: equal statements are one term."""
        return self._make(quoted(f"?{sort} {level}"), (), sort)

    def blank(self, sort: str = INT) -> Term:
        """A fresh variable that no quantifier binds."""
        self._blanks += 1
        return self._make(quoted(f"?blank {self._blanks}"), (), sort)

    def free(self, term: Term) -> frozenset[str]:
        """The variables that are free in a term, by their heads."""
        found = self._free.get(id(term))
        if found is None:
            # Inside out, since terms may be deep.
            pending = [term]
            while pending:
                node = pending[-1]
                below = [a for a in node.args if id(a) not in self._free]
                if below:
                    pending += below
                    continue
                pending.pop()
                names = frozenset[str]().union(*(self._free[id(a)] for a in node.args))
                if node.head.startswith("|?"):
                    names |= {node.head}
                self._free[id(node)] = names - {b.head for b in node.binders}
            found = self._free[id(term)]
        return found

    def put(self, term: Term, old: Term, new: Term) -> Term:
        """Substitute a term for a variable, folding anew."""
        if old is new or old.head not in self.free(term):
            return term
        known = self._put.setdefault((id(old), id(new)), {id(old): new})

        def instead(node: Term) -> Term | None:
            if old.head not in self.free(node):
                return node
            if any(b.head in self.free(new) for b in node.binders):
                # What the new term speaks of is not what this quantifier does.
                return self.put(self._renamed(node), old, new)
            return None

        return self.rebuilt(term, known, instead)

    def rebuilt(
        self, term: Term, known: dict[int, Term], instead: Callable[[Term], Term | None]
    ) -> Term:
        """Substitute terms for parts of a term, folding anew.

        ``instead`` says what stands for a part; None where its own parts are to be looked at.
        ``known`` keeps what came of each part, by its id.
        """
        # Inside out, since terms may be deep.
        pending = [term]
        while pending:
            node = pending[-1]
            if id(node) in known:
                pending.pop()
                continue
            below = [a for a in node.args if id(a) not in known]
            if (other := instead(node)) is not None:
                known[id(node)] = other
            elif below:
                pending += below
            else:
                known[id(node)] = self.again(node, [known[id(a)] for a in node.args])
        return known[id(term)]

    def _renamed(self, node: Term) -> Term:
        """The quantifier with fresh bound variables."""
        (body,), fresh = node.args, []
        for b in node.binders:
            fresh.append(self.blank(b.sort))
            body = self.put(body, b, fresh[-1])
        return self.for_all(fresh, body)

    def again(self, node: Term, args: list[Term]) -> Term:
        """The same operation on other operands, folded."""
        match node.head, args:
            case "and", _:
                return self.conjunction(args)
            case "or", _:
                return self.disjunction(args)
            case "not", [a]:
                return self.negation(a)
            case "ite", [a, b, c]:
                return self.ite(a, b, c)
            case "=", [a, b]:
                return self.equal(a, b)
            case "<", [a, b]:
                return self.less(a, b)
            case "<=", [a, b]:
                return self.at_most(a, b)
            case "+", [a, b]:
                return self.plus(a, b)
            case "-", [a, b]:
                return self.minus(a, b)
            case "-", [a]:
                return self.negative(a)
            case "*", [a, b]:
                return self.times(a, b)
            case "forall", [a]:
                return self.for_all(node.binders, a)
            case "to_real", [a]:
                return self.widened(a)
            case _:
                return self._make(node.head, tuple(args), node.sort, node.value, node.binders)

    # --- numbers --------------------------------------------------------------------------------

    def less(self, a: Term, b: Term) -> Term:
        return self._compare("<", a, b)

    def at_most(self, a: Term, b: Term) -> Term:
        return self._compare("<=", a, b)

    def _compare(self, head: str, a: Term, b: Term) -> Term:
        if a is b:
            return self.truth(head == "<=")
        if a.value is not None and b.value is not None:
            return self.truth(a.value < b.value if head == "<" else a.value <= b.value)
        return self._make(head, (a, b), BOOL)

    def plus(self, a: Term, b: Term) -> Term:
        if a.value is not None and b.value is not None:
            return self._number(a.value + b.value, a.sort)
        if a.value == 0:
            return b
        return a if b.value == 0 else self._make("+", (a, b), a.sort)

    def minus(self, a: Term, b: Term) -> Term:
        if a.value is not None and b.value is not None:
            return self._number(a.value - b.value, a.sort)
        if a is b:
            return self._number(0, a.sort)
        return a if b.value == 0 else self._make("-", (a, b), a.sort)

    def negative(self, a: Term) -> Term:
        if a.value is not None:
            return self._number(-a.value, a.sort)
        return self._make("-", (a,), a.sort)

    def times(self, a: Term, b: Term) -> Term:
        if a.value is not None and b.value is not None:
            return self._number(a.value * b.value, a.sort)
        if a.value == 0 or b.value == 1:
            return a
        return b if b.value == 0 or a.value == 1 else self._make("*", (a, b), a.sort)

    def quotient(self, a: Term, b: Term) -> Term:
        """Divide reals. By zero it is some number; the fault is recorded elsewhere."""
        if a.value is not None and b.value:
            return self.real(Fraction(a.value) / Fraction(b.value))
        if b.value:
            return self.times(a, self.real(1 / Fraction(b.value)))
        return self._make("/", (a, b), REAL)

    def floored(self, a: Term, b: Term) -> Term:
        """Divide integers, rounding down; SMT-LIB's ``div`` does so for positive divisors only."""
        if a.value is not None and b.value:
            return self.integer(int(a.value) // int(b.value))
        if b.value is not None and b.value > 0:
            return a if b.value == 1 else self._make("div", (a, b), INT)
        down = self._make("div", (a, b), INT)
        up = self._make("div", (self.negative(a), self.negative(b)), INT)
        return self.ite(self.less(self.integer(0), b), down, up)

    def remainder(self, a: Term, b: Term) -> Term:
        """``a - b * floor(a / b)``: zero, or with the sign of the divisor."""
        if a.value is not None and b.value:
            return self.integer(int(a.value) % int(b.value))
        return self.minus(a, self.times(b, self.floored(a, b)))

    def widened(self, a: Term) -> Term:
        if a.value is not None:
            return self.real(Fraction(a.value))
        if a.head == "ite" and any(arg.value is not None for arg in a.args[1:]):
            return self.ite(a.args[0], self.widened(a.args[1]), self.widened(a.args[2]))
        return self._make("to_real", (a,), REAL)
