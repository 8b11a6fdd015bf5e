"""Fast construction of Z3 terms by the C interface.

Z3's Python operators look for the context, the common sort and the kind of their arguments first,
which takes several times longer than to make the term. Here all arguments are terms of one context
and of the sorts that are needed: who calls has seen to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import z3

_Two: Final = z3.Ast * 2


class TermBuilder:
    """A builder of terms of one Z3 context."""

    def __init__(self, context: z3.Context) -> None:
        self._context = context
        self._ref = context.ref()
        self._symbols: dict[tuple[str, tuple[int, ...], int], z3.FuncDeclRef] = {}
        self._names: dict[int, tuple[z3.FuncDeclRef, str]] = {}

    # --- Booleans -------------------------------------------------------------------------------

    def conjunction(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(z3.Z3_mk_and(self._ref, 2, _Two(left.ast, right.ast)))

    def disjunction(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(z3.Z3_mk_or(self._ref, 2, _Two(left.ast, right.ast)))

    def negation(self, operand: z3.ExprRef) -> z3.BoolRef:
        """Negate a Boolean; a double negation is removed."""
        if self.kind(operand) == z3.Z3_OP_NOT:
            return self._boolean(z3.Z3_get_app_arg(self._ref, operand.ast, 0))
        return self._boolean(z3.Z3_mk_not(self._ref, operand.ast))

    def equation(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(z3.Z3_mk_eq(self._ref, left.ast, right.ast))

    def less(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(z3.Z3_mk_lt(self._ref, left.ast, right.ast))

    def at_most(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(z3.Z3_mk_le(self._ref, left.ast, right.ast))

    # --- numbers --------------------------------------------------------------------------------

    def total(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(z3.Z3_mk_add(self._ref, 2, _Two(left.ast, right.ast)))

    def difference(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(z3.Z3_mk_sub(self._ref, 2, _Two(left.ast, right.ast)))

    def product(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(z3.Z3_mk_mul(self._ref, 2, _Two(left.ast, right.ast)))

    def opposite(self, operand: z3.ExprRef) -> z3.ArithRef:
        return self._number(z3.Z3_mk_unary_minus(self._ref, operand.ast))

    def widened(self, operand: z3.ExprRef) -> z3.ArithRef:
        return self._number(z3.Z3_mk_int2real(self._ref, operand.ast))

    # --- terms of any sort ----------------------------------------------------------------------

    def choice(self, condition: z3.ExprRef, then: z3.ExprRef, other: z3.ExprRef) -> z3.ExprRef:
        """If-then-else of two terms of the same sort."""
        made = z3.Z3_mk_ite(self._ref, condition.ast, then.ast, other.ast)
        if isinstance(then, z3.ArithRef):
            return self._number(made)
        if isinstance(then, z3.BoolRef):
            return self._boolean(made)
        return self._any(made)

    def applied(self, name: str, arguments: Sequence[z3.ExprRef], result: z3.SortRef) -> z3.ExprRef:
        """Apply a function symbol to arguments; one name and sorts have one symbol."""
        ids = [z3.Z3_get_sort_id(self._ref, z3.Z3_get_sort(self._ref, a.ast)) for a in arguments]
        key = (name, tuple(ids), result.get_id())
        symbol = self._symbols.get(key)
        if symbol is None:
            symbol = z3.Function(name, *(a.sort() for a in arguments), result)
            self._symbols[key] = symbol
        many = (z3.Ast * len(arguments))(*(a.ast for a in arguments))
        return self._any(z3.Z3_mk_app(self._ref, symbol.ast, len(arguments), many))

    def kind(self, term: z3.ExprRef) -> int:
        """The kind of symbol that a term applies: a ``Z3_OP`` number; -1 for quantifiers."""
        if z3.Z3_get_ast_kind(self._ref, term.ast) not in (z3.Z3_APP_AST, z3.Z3_NUMERAL_AST):
            return -1
        return int(z3.Z3_get_decl_kind(self._ref, z3.Z3_get_app_decl(self._ref, term.ast)))

    def leanings(self, term: z3.ExprRef, seen: set[tuple[int, int]]) -> Iterator[tuple[str, bool]]:
        """As :meth:`koord.verify.encoding.terms.Terms.leanings`."""
        ref, waiting = self._ref, [(term.ast, 1)]
        while waiting:
            part, sign = waiting.pop()
            key = z3.Z3_get_ast_id(ref, part), sign
            if key in seen:
                continue
            seen.add(key)
            written = z3.Z3_get_ast_kind(ref, part)
            if written == z3.Z3_QUANTIFIER_AST:
                waiting.append((z3.Z3_get_quantifier_body(ref, part), 0))
            if written != z3.Z3_APP_AST:
                continue  # it has no parts
            symbol = z3.Z3_get_app_decl(ref, part)
            below = [
                z3.Z3_get_app_arg(ref, part, k) for k in range(z3.Z3_get_app_num_args(ref, part))
            ]
            signs = [0] * len(below)
            match z3.Z3_get_decl_kind(ref, symbol):
                case z3.Z3_OP_NOT:
                    signs = [-sign]
                case z3.Z3_OP_AND | z3.Z3_OP_OR:
                    signs = [sign] * len(below)
                case z3.Z3_OP_IMPLIES:
                    signs = [-sign, sign]
                case z3.Z3_OP_ITE if self._is_boolean(part):
                    signs = [0, sign, sign]
                case z3.Z3_OP_UNINTERPRETED:
                    name = self._name(symbol)
                    if sign >= 0:
                        yield name, True
                    if sign <= 0:
                        yield name, False
            waiting += zip(below, signs, strict=True)

    def _is_boolean(self, part: z3.Ast) -> bool:
        sort = z3.Z3_get_sort(self._ref, part)
        return bool(z3.Z3_get_sort_kind(self._ref, sort) == z3.Z3_BOOL_SORT)

    def _name(self, symbol: z3.FuncDecl) -> str:
        """The name of a symbol, as text."""
        number = z3.Z3_get_func_decl_id(self._ref, symbol)
        if number not in self._names:
            kept = z3.FuncDeclRef(symbol, self._context)  # or its number may be another's one day
            self._names[number] = kept, str(kept.name())
        return self._names[number][1]

    def _boolean(self, made: z3.Ast) -> z3.BoolRef:
        return z3.BoolRef(made, self._context)

    def _number(self, made: z3.Ast) -> z3.ArithRef:
        return z3.ArithRef(made, self._context)

    def _any(self, made: z3.Ast) -> z3.ExprRef:
        found = z3.z3._to_expr_ref(made, self._context)
        assert isinstance(found, z3.ExprRef)
        return found


def same(left: z3.ExprRef, right: z3.ExprRef) -> bool:
    """Return whether two terms of one context are identical: Z3 keeps each term once."""
    return bool(left.ast.value == right.ast.value)
