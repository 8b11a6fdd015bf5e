"""Fast construction of Z3 terms by the C interface.

Z3's Python operators look for the context, the common sort and the kind of their arguments first,
which takes several times longer than to make the term. Here all arguments are terms of one context
and of the sorts that are needed: who calls has seen to it. That interface also asks after each call
whether it failed, and takes every argument through a function of Python, which takes several times
as long as most calls do. What makes a term returns nothing where it fails, which the builder looks
at; what asks about a term does not fail for terms that there are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterator, Sequence
from fractions import Fraction
from typing import Any, Final, NoReturn, TypeVar

from koord.verify.encoding.z3_loading import address_of, z3

_One: Final = z3.Ast * 1
_Two: Final = z3.Ast * 2

T = TypeVar("T")


def _function(name: str, result: Any) -> Any:
    """A C function of Z3, called without what its Python interface does around each call.

    Arguments are what that interface has for them, or numbers. Python's lock is kept meanwhile: to
    let it go and to take it again takes as long as most of these calls do.
    """
    return ctypes.PYFUNCTYPE(result)(address_of(name))


# --- making terms ---------------------------------------------------------------------------------

_mk_add = _function("Z3_mk_add", z3.Ast)
_mk_and = _function("Z3_mk_and", z3.Ast)
_mk_app = _function("Z3_mk_app", z3.Ast)
_mk_const = _function("Z3_mk_const", z3.Ast)
_mk_div = _function("Z3_mk_div", z3.Ast)
_mk_eq = _function("Z3_mk_eq", z3.Ast)
_mk_false = _function("Z3_mk_false", z3.Ast)
_mk_func_decl = _function("Z3_mk_func_decl", z3.FuncDecl)
_mk_fresh_const = _function("Z3_mk_fresh_const", z3.Ast)
_mk_gt = _function("Z3_mk_gt", z3.Ast)
_mk_implies = _function("Z3_mk_implies", z3.Ast)
_mk_int2real = _function("Z3_mk_int2real", z3.Ast)
_mk_ite = _function("Z3_mk_ite", z3.Ast)
_mk_le = _function("Z3_mk_le", z3.Ast)
_mk_lt = _function("Z3_mk_lt", z3.Ast)
_mk_mod = _function("Z3_mk_mod", z3.Ast)
_mk_mul = _function("Z3_mk_mul", z3.Ast)
_mk_not = _function("Z3_mk_not", z3.Ast)
_mk_numeral = _function("Z3_mk_numeral", z3.Ast)
_mk_or = _function("Z3_mk_or", z3.Ast)
_mk_string_symbol = _function("Z3_mk_string_symbol", z3.Symbol)
_mk_sub = _function("Z3_mk_sub", z3.Ast)
_mk_true = _function("Z3_mk_true", z3.Ast)
_mk_unary_minus = _function("Z3_mk_unary_minus", z3.Ast)
_substitute = _function("Z3_substitute", z3.Ast)

#: By which a term is counted as long as Python has it.
_inc_ref = _function("Z3_inc_ref", None)
_dec_ref = _function("Z3_dec_ref", None)

# --- constraints ----------------------------------------------------------------------------------

_get_error_code = _function("Z3_get_error_code", ctypes.c_uint)
_solver_assert = _function("Z3_solver_assert", None)

# --- asking about solvers -------------------------------------------------------------------------

_stats_get_double_value = _function("Z3_stats_get_double_value", ctypes.c_double)
_stats_get_key = _function("Z3_stats_get_key", ctypes.c_char_p)
_stats_get_uint_value = _function("Z3_stats_get_uint_value", ctypes.c_uint)
_stats_is_uint = _function("Z3_stats_is_uint", ctypes.c_bool)
_stats_size = _function("Z3_stats_size", ctypes.c_uint)

# --- asking about terms ---------------------------------------------------------------------------

_get_app_arg = _function("Z3_get_app_arg", z3.Ast)
_get_app_decl = _function("Z3_get_app_decl", z3.FuncDecl)
_get_app_num_args = _function("Z3_get_app_num_args", ctypes.c_uint)
_get_ast_id = _function("Z3_get_ast_id", ctypes.c_uint)
_get_ast_kind = _function("Z3_get_ast_kind", ctypes.c_uint)
_get_decl_kind = _function("Z3_get_decl_kind", ctypes.c_uint)
_get_func_decl_id = _function("Z3_get_func_decl_id", ctypes.c_uint)
_get_quantifier_body = _function("Z3_get_quantifier_body", z3.Ast)
_get_sort = _function("Z3_get_sort", z3.Sort)
_get_sort_id = _function("Z3_get_sort_id", ctypes.c_uint)
_get_sort_kind = _function("Z3_get_sort_kind", ctypes.c_uint)
_model_eval = _function("Z3_model_eval", ctypes.c_bool)


#: How terms are written, and the symbols by which they are taken apart.
_APP: Final = z3.Z3_APP_AST
_QUANTIFIER: Final = z3.Z3_QUANTIFIER_AST
_UNINTERPRETED: Final = z3.Z3_OP_UNINTERPRETED
_NOT: Final = z3.Z3_OP_NOT
_IMPLIES: Final = z3.Z3_OP_IMPLIES
_ITE: Final = z3.Z3_OP_ITE
_ALIKE: Final = (z3.Z3_OP_AND, z3.Z3_OP_OR)


class _Counted:
    """A term that is let go without asking whether that failed, which it does not.

    Its context may be gone before it, where both are found by the garbage collector.
    """

    ast: z3.Ast
    ctx: z3.Context

    def __del__(self, let_go: Any = _dec_ref) -> None:
        if (context := self.ctx.ctx) is not None:
            let_go(context, self.ast)


class _Boolean(_Counted, z3.BoolRef):  # type: ignore[misc]
    pass


class _Number(_Counted, z3.ArithRef):  # type: ignore[misc]
    pass


class _Integer(_Counted, z3.IntNumRef):  # type: ignore[misc]
    pass


class _Rational(_Counted, z3.RatNumRef):  # type: ignore[misc]
    pass


class TermBuilder:
    """A builder of terms of one Z3 context."""

    def __init__(self, context: z3.Context) -> None:
        self._context = context
        self._ref = context.ref()
        self._int, self._real = z3.IntSort(context), z3.RealSort(context)
        self._bool = z3.BoolSort(context)
        self._symbols: dict[
            tuple[str, tuple[int, ...], int], tuple[z3.FuncDeclRef, type[z3.ExprRef] | None]
        ] = {}
        self._names: dict[int, tuple[z3.FuncDeclRef, str]] = {}

    # --- Booleans -------------------------------------------------------------------------------

    def conjunction(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_and(self._ref, 2, _Two(left.ast, right.ast)))

    def disjunction(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_or(self._ref, 2, _Two(left.ast, right.ast)))

    def negation(self, operand: z3.ExprRef) -> z3.BoolRef:
        """Negate a Boolean; a double negation is removed."""
        if self.kind(operand) == z3.Z3_OP_NOT:
            return self._boolean(_get_app_arg(self._ref, operand.ast, 0))
        return self._boolean(_mk_not(self._ref, operand.ast))

    def implication(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_implies(self._ref, left.ast, right.ast))

    def label(self, prefix: str) -> z3.BoolRef:
        """A Boolean constant that nobody has, whose name begins with the prefix."""
        return self._boolean(_mk_fresh_const(self._ref, prefix.encode(), self._bool.ast))

    def equation(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_eq(self._ref, left.ast, right.ast))

    def less(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_lt(self._ref, left.ast, right.ast))

    def more(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_gt(self._ref, left.ast, right.ast))

    def at_most(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.BoolRef:
        return self._boolean(_mk_le(self._ref, left.ast, right.ast))

    # --- numbers --------------------------------------------------------------------------------

    def total(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(_mk_add(self._ref, 2, _Two(left.ast, right.ast)))

    def difference(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(_mk_sub(self._ref, 2, _Two(left.ast, right.ast)))

    def product(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        return self._number(_mk_mul(self._ref, 2, _Two(left.ast, right.ast)))

    def quotient(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        """Divide as Z3 does: integers are rounded down for positive divisors, else up."""
        return self._number(_mk_div(self._ref, left.ast, right.ast))

    def remainder(self, left: z3.ExprRef, right: z3.ExprRef) -> z3.ArithRef:
        """What is left of integers then, which is never negative."""
        return self._number(_mk_mod(self._ref, left.ast, right.ast))

    def opposite(self, operand: z3.ExprRef) -> z3.ArithRef:
        return self._number(_mk_unary_minus(self._ref, operand.ast))

    def widened(self, operand: z3.ExprRef) -> z3.ArithRef:
        return self._number(_mk_int2real(self._ref, operand.ast))

    def numeral(self, value: int | Fraction, *, real: bool) -> z3.ExprRef:
        """A number, of reals or of integers."""
        text, sort = str(value).encode(), self._real if real else self._int
        made = _mk_numeral(self._ref, text, sort.ast)
        return self._kept(_Rational if real else _Integer, made)

    def truth(self, *, value: bool) -> z3.BoolRef:
        """A constant truth."""
        return self._boolean((_mk_true if value else _mk_false)(self._ref))

    # --- terms of any sort ----------------------------------------------------------------------

    def choice(self, condition: z3.ExprRef, then: z3.ExprRef, other: z3.ExprRef) -> z3.ExprRef:
        """If-then-else of two terms of the same sort."""
        made = _mk_ite(self._ref, condition.ast, then.ast, other.ast)
        if isinstance(then, z3.ArithRef):
            return self._number(made)
        if isinstance(then, z3.BoolRef):
            return self._boolean(made)
        return self.any(made)

    def constant(self, name: str, sort: z3.SortRef) -> z3.ExprRef:
        """The uninterpreted constant of a name and a sort."""
        symbol = _mk_string_symbol(self._ref, name.encode())
        return self.any(_mk_const(self._ref, symbol, sort.ast))

    def applied(self, name: str, arguments: Sequence[z3.ExprRef], result: z3.SortRef) -> z3.ExprRef:
        """Apply a function symbol to arguments; one name and sorts have one symbol."""
        count = len(arguments)
        sorts = [_get_sort(self._ref, argument.ast) for argument in arguments]
        ids = tuple(_get_sort_id(self._ref, sort) for sort in sorts)
        key = (name, ids, _get_sort_id(self._ref, result.ast))
        known = self._symbols.get(key)
        if known is None:
            text = _mk_string_symbol(self._ref, name.encode())
            made = _mk_func_decl(self._ref, text, count, (z3.Sort * count)(*sorts), result.ast)
            if not made:
                self._fail()
            known = z3.FuncDeclRef(made, self._context), self._form_of(result)
            self._symbols[key] = known
        symbol, form = known
        many = (z3.Ast * count)(*(a.ast for a in arguments))
        made = _mk_app(self._ref, symbol.ast, count, many)
        return self.any(made) if form is None else self._kept(form, made)

    def _form_of(self, sort: z3.SortRef) -> type[z3.ExprRef] | None:
        """What terms of a sort are that are neither numerals nor quantified; None: that differs."""
        match _get_sort_kind(self._ref, sort.ast):
            case z3.Z3_BOOL_SORT:
                return _Boolean
            case z3.Z3_INT_SORT:
                return _Number
        return None

    def put(
        self, term: z3.ExprRef, old: Sequence[z3.ExprRef], new: Sequence[z3.ExprRef]
    ) -> z3.ExprRef:
        """Substitute terms, each for one of its sort (which z3.substitute makes sure of)."""
        made = self.substituted(term, old, new)
        # A Boolean that is neither quantified nor a constant stays one.
        return self._boolean(made) if type(term) is _Boolean else self.any(made)

    def substituted(
        self, term: z3.ExprRef, old: Sequence[z3.ExprRef], new: Sequence[z3.ExprRef]
    ) -> z3.Ast:
        """The same, where nobody keeps what comes of it."""
        many = z3.Ast * len(old)
        before, after = many(*(one.ast for one in old)), many(*(one.ast for one in new))
        return _substitute(self._ref, term.ast, len(old), before, after)

    def number_of(self, term: z3.ExprRef) -> int:
        """The number that a term has as long as it is kept, and no other."""
        return int(_get_ast_id(self._ref, term.ast))

    def sort_number(self, term: z3.ExprRef) -> int:
        """The number of the sort of a term: as long as the term is kept no other has it."""
        return int(_get_sort_id(self._ref, _get_sort(self._ref, term.ast)))

    def is_constant(self, term: z3.ExprRef) -> bool:
        """Return whether a term is an uninterpreted constant."""
        if self.kind(term) != z3.Z3_OP_UNINTERPRETED:
            return False
        return not _get_app_num_args(self._ref, term.ast)

    def is_true_in(self, model: z3.ModelRef, condition: z3.ExprRef) -> bool:
        """Return whether a Boolean is true in a model, where what that leaves open has values."""
        found = _One()
        done = _model_eval(self._ref, model.model, condition.ast, ctypes.c_bool(True), found)
        if not done or not found[0]:
            self._fail()
        kept = self._boolean(found[0])
        return bool(self.kind(kept) == z3.Z3_OP_TRUE)

    def sort_kind(self, term: z3.ExprRef) -> int:
        """The kind of sort that a term has: a ``Z3_SORT`` number."""
        return int(_get_sort_kind(self._ref, _get_sort(self._ref, term.ast)))

    def kind(self, term: z3.ExprRef) -> int:
        """The kind of symbol that a term applies: a ``Z3_OP`` number; -1 for quantifiers."""
        if _get_ast_kind(self._ref, term.ast) not in (z3.Z3_APP_AST, z3.Z3_NUMERAL_AST):
            return -1
        return int(_get_decl_kind(self._ref, _get_app_decl(self._ref, term.ast)))

    def parts_like(self, term: z3.ExprRef) -> Iterator[z3.ExprRef]:
        """The subterms of a term that have its sort, each once, itself first.

        They are looked for as they are asked for. What a quantifier binds is no term by itself.
        """
        ref, waiting, seen = self._ref, [term.ast], set[int]()
        wanted = _get_sort_id(ref, _get_sort(ref, term.ast))
        while waiting:
            part = waiting.pop()
            number = _get_ast_id(ref, part)
            if number in seen:
                continue
            seen.add(number)
            if _get_sort_id(ref, _get_sort(ref, part)) == wanted:
                yield self.any(part)
            if _get_ast_kind(ref, part) == z3.Z3_APP_AST:
                below = range(_get_app_num_args(ref, part))
                waiting += [_get_app_arg(ref, part, k) for k in below]

    def leanings(
        self, term: z3.ExprRef, seen: set[int], before: Collection[int]
    ) -> Iterator[tuple[str, bool]]:
        """As :meth:`koord.verify.encoding.terms.Terms.leanings`."""
        ref, waiting = self._ref, [(term.ast, 1)]
        while waiting:
            part, sign = waiting.pop()
            key = 3 * _get_ast_id(ref, part) + sign
            if key in seen or key in before:
                continue
            seen.add(key)
            written = _get_ast_kind(ref, part)
            if written != _APP:
                if written == _QUANTIFIER:
                    waiting.append((_get_quantifier_body(ref, part), 0))
                continue  # it has no parts
            symbol = _get_app_decl(ref, part)
            kind = _get_decl_kind(ref, symbol)
            if kind == _UNINTERPRETED:
                name = self._name(symbol)
                if sign >= 0:
                    yield name, True
                if sign <= 0:
                    yield name, False
            count = _get_app_num_args(ref, part)
            if not count:
                continue
            below = [_get_app_arg(ref, part, k) for k in range(count)]
            if kind in _ALIKE:
                waiting += [(one, sign) for one in below]
            elif kind == _NOT:
                waiting.append((below[0], -sign))
            elif kind == _IMPLIES:
                waiting += [(below[0], -sign), (below[1], sign)]
            elif kind == _ITE and self._is_boolean(part):
                waiting += [(below[0], 0), (below[1], sign), (below[2], sign)]
            else:
                waiting += [(one, 0) for one in below]

    def _is_boolean(self, part: z3.Ast) -> bool:
        sort = _get_sort(self._ref, part)
        return bool(_get_sort_kind(self._ref, sort) == z3.Z3_BOOL_SORT)

    def _name(self, symbol: z3.FuncDecl) -> str:
        """The name of a symbol, as text."""
        number = _get_func_decl_id(self._ref, symbol)
        if number not in self._names:
            kept = z3.FuncDeclRef(symbol, self._context)  # or its number may be another's one day
            self._names[number] = kept, str(kept.name())
        return self._names[number][1]

    def any(self, made: z3.Ast) -> z3.ExprRef:
        """A term of whatever sort, as Z3's Python interface has it."""
        if not made:
            self._fail()
        if _get_ast_kind(self._ref, made) == z3.Z3_APP_AST:
            match _get_sort_kind(self._ref, _get_sort(self._ref, made)):
                case z3.Z3_BOOL_SORT:
                    return self._boolean(made)
                case z3.Z3_INT_SORT:
                    return self._number(made)
        found = z3.z3._to_expr_ref(made, self._context)
        assert isinstance(found, z3.ExprRef)
        return found

    def _boolean(self, made: z3.Ast) -> z3.BoolRef:
        return self._kept(_Boolean, made)

    def _number(self, made: z3.Ast) -> z3.ArithRef:
        return self._kept(_Number, made)

    def _kept(self, form: type[T], made: z3.Ast) -> T:
        """A term as an object of Python, which counts as a user of it until it is gone."""
        if not made:
            self._fail()
        found: Any = object.__new__(form)
        found.ast, found.ctx = made, self._context
        _inc_ref(self._ref, made)
        return found  # type: ignore[no-any-return]

    def _fail(self) -> NoReturn:
        """Say why no term was made."""
        code = z3.Z3_get_error_code(self._ref)
        raise z3.Z3Exception(z3.Z3_get_error_msg(self._ref, code))


def require(solver: z3.Solver, constraint: z3.BoolRef) -> None:
    """Add a constraint to a solver of its context."""
    context = solver.ctx.ref()
    _solver_assert(context, solver.solver, constraint.ast)
    if code := _get_error_code(context):
        raise z3.Z3Exception(z3.Z3_get_error_msg(context, code))


def counted(statistics: z3.Statistics, name: str) -> int:
    """What a solver counted under a name; 0 where it has not counted that."""
    context, known, key = statistics.ctx.ref(), statistics.stats, name.encode()
    # What all solvers count stands behind what each of them does.
    for k in reversed(range(_stats_size(context, known))):
        if _stats_get_key(context, known, k) == key:
            if _stats_is_uint(context, known, k):
                return int(_stats_get_uint_value(context, known, k))
            return int(_stats_get_double_value(context, known, k))  # it is too large for the other
    return 0


def spent_by(solver: z3.Solver | z3.Fixedpoint) -> int:
    """The effort that the solvers of a solver's context have spent so far, in their own units."""
    return counted(solver.statistics(), "rlimit count")


def same(left: z3.ExprRef, right: z3.ExprRef) -> bool:
    """Return whether two terms of one context are identical: Z3 keeps each term once."""
    return bool(left.ast.value == right.ast.value)
