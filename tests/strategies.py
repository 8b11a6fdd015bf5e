"""Hypothesis strategies: trees of syntax, any that the parser can make."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any, ParamSpec, TypeVar, cast

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from koord.syntax import ast

T = TypeVar("T")
P = ParamSpec("P")

#: Names, with all the words among them that are keywords only where their construct is.
WORDS = [
    "x",
    "y",
    "z",
    "pid",
    "numAgents",
    "list",
    "map",
    "queue",
    "at",
    "round",
    "result",
    "extern",
    "fresh",
    "choose",
    "ran",
    "module",
    "adt",
    "fun",
    "sensors",
    "actuators",
    "environment",
    "contract",
    "requires",
    "ensures",
    "delta",
    "Motion",
    "Task",
    "e1",
    "E",
    "_a",
    "stdout",
    "while",
]
TYPE_WORDS = ["int", "float", "bool", "boolean", "string", "pos", "Point", "Task", "stream", "list"]

#: How deep expressions and blocks of examples are.
EXPRESSION_DEPTH = 3
BLOCK_DEPTH = 2


def lazily(make: Callable[P, SearchStrategy[T]]) -> Callable[P, SearchStrategy[T]]:
    """The strategy made when it is drawn from, so that strategies may contain themselves."""

    def strategy(*args: P.args, **kwargs: P.kwargs) -> SearchStrategy[T]:
        return st.deferred(lambda: make(*args, **kwargs))

    return cast(Callable[P, SearchStrategy[T]], cache(strategy))


names = st.sampled_from(WORDS)
idents = names.map(ast.Ident)


def tuples_of(
    items: SearchStrategy[T], *, least: int = 0, most: int = 3
) -> SearchStrategy[tuple[T, ...]]:
    """Tuples of a few items."""
    return st.lists(items, min_size=least, max_size=most).map(tuple)


def _decimal(digits: int, exponent: int) -> ast.FloatLit:
    return ast.FloatLit(Fraction(digits) * Fraction(10) ** exponent)


#: Characters that may stand in a string literal.
_CHARACTERS = st.one_of(
    st.sampled_from('\n\t"\\ab {}#/'), st.characters(exclude_categories=("Cs", "Cc"))
)

_leaves: SearchStrategy[ast.Expr] = st.one_of(
    names.map(ast.Name),
    st.integers(0, 10**12).map(ast.IntLit),
    st.builds(_decimal, st.integers(0, 10**9), st.integers(-30, 30)),
    st.booleans().map(ast.BoolLit),
    st.text(_CHARACTERS, max_size=5).map(ast.StringLit),
)


@lazily
def types(depth: int = 2) -> SearchStrategy[ast.TypeExpr]:
    """Types as written."""
    plain: SearchStrategy[ast.TypeExpr] = st.sampled_from(TYPE_WORDS).map(ast.NamedType)
    if not depth:
        return plain
    inner = types(depth - 1)
    return st.one_of(
        plain,
        st.builds(
            ast.NamedType, st.sampled_from(["List", "Queue", "Map"]), tuples_of(inner, least=1)
        ),
        st.builds(ast.ArrayTypeExpr, inner, st.none() | expressions(1)),
    )


@lazily
def expressions(depth: int = EXPRESSION_DEPTH) -> SearchStrategy[ast.Expr]:
    """Expressions, quantifiers and all."""
    if not depth:
        return _leaves
    inner = expressions(depth - 1)
    items = tuples_of(inner)
    arguments = tuples_of(st.builds(ast.Argument, st.none() | names, inner))
    binary: SearchStrategy[ast.Expr] = st.builds(
        ast.Binary, st.sampled_from(ast.BinaryOp), inner, inner
    )
    return st.one_of(
        _leaves,
        binary,
        binary,
        st.builds(ast.Unary, st.sampled_from(ast.UnaryOp), inner),
        st.builds(ast.ListLit, items),
        st.builds(ast.MapLit, tuples_of(st.tuples(inner, inner))),
        st.builds(ast.SetLit, tuples_of(inner, least=1)),
        st.builds(ast.Call, idents, arguments),
        st.builds(ast.MethodCall, inner, idents, arguments),
        st.builds(ast.Index, inner, inner),
        st.builds(ast.Attribute, inner, idents),
        st.builds(ast.AtRobot, inner, inner),
        st.builds(ast.Prime, inner),
        st.builds(ast.Quantified, st.sampled_from(ast.Quantifier), binders(depth - 1), inner),
    )


@st.composite
def binders(draw: Callable[[SearchStrategy[Any]], Any], depth: int) -> tuple[ast.Binder, ...]:
    """What a quantifier binds.

    Names over robots do not follow a binder that would take them for its own, and nothing follows
    them: ``i, k in 0, n`` is one binder with two names.
    """
    found: list[ast.Binder] = []
    inner = expressions(depth)
    for _ in range(draw(st.integers(1, 3))):
        last = found[-1] if found else None
        bounded = last is None or last.high is not None
        if bounded and draw(st.booleans()):
            found.append(ast.Binder(draw(tuples_of(idents, least=1))))
            break
        some = draw(tuples_of(idents, least=1, most=2 if bounded else 1))
        kind = draw(st.integers(0, 2))
        if kind == 0:
            found.append(ast.Binder(some, low=draw(inner), high=draw(inner)))
        elif kind == 1:
            found.append(ast.Binder(some, over=draw(inner)))
        else:
            found.append(ast.Binder(draw(tuples_of(idents, least=1)), type=draw(types(1))))
    return tuple(found)


@lazily
def places() -> SearchStrategy[ast.Expr]:
    """What can be written: names, elements, fields."""
    return st.recursive(
        names.map(ast.Name),
        lambda base: (
            st.builds(ast.Index, base, expressions(1)) | st.builds(ast.Attribute, base, idents)
        ),
        max_leaves=3,
    )


@lazily
def declarations() -> SearchStrategy[ast.VarDecl]:
    """Declarations with and without a value."""
    return st.builds(ast.VarDecl, types(), idents, st.none() | expressions(2))


@lazily
def calls() -> SearchStrategy[ast.Call | ast.MethodCall]:
    """Calls as statements."""
    arguments = tuples_of(st.builds(ast.Argument, st.none() | names, expressions(1)))
    return st.builds(ast.Call, idents, arguments) | st.builds(
        ast.MethodCall, expressions(1), idents, arguments
    )


@lazily
def statements(depth: int = BLOCK_DEPTH) -> SearchStrategy[ast.Stmt]:
    """Statements with the blocks in them."""
    expression = expressions(2)
    simple: SearchStrategy[ast.Stmt] = st.one_of(
        st.builds(ast.Assign, places(), expression),
        st.builds(ast.Increment, places(), st.sampled_from([1, -1])),
        st.builds(ast.Break),
        st.builds(ast.Return, st.none() | expression),
        st.builds(ast.Stop),
        st.builds(ast.TryStop),
        st.builds(ast.Output, expressions(1), tuples_of(expression, least=1)),
        st.builds(ast.LocalDecl, declarations()),
        st.builds(ast.Pass),
        st.builds(ast.CallStmt, calls()),
    )
    if not depth:
        return simple
    body = blocks(depth - 1)
    return st.one_of(
        simple,
        st.builds(
            ast.If, tuples_of(st.tuples(expression, body), least=1, most=2), st.none() | body
        ),
        st.builds(ast.ForRange, idents, expression, expression, body),
        st.builds(ast.ForEach, tuples_of(idents, least=1, most=2), expression, body),
        st.builds(ast.Repeat, expression, body),
        st.builds(ast.Atomic, body),
    )


@lazily
def blocks(depth: int = BLOCK_DEPTH) -> SearchStrategy[ast.Block]:
    """Blocks of at least one statement."""
    return tuples_of(statements(depth), least=1)


@st.composite
def functions(draw: Callable[[SearchStrategy[Any]], Any]) -> ast.FunDef:
    """Functions with a body, and external ones with a summary."""
    parameters = draw(tuples_of(st.builds(ast.VarDecl, types(), idents)))
    head = (draw(idents), parameters, draw(st.none() | types()))
    if draw(st.booleans()):
        return ast.FunDef(*head, draw(blocks(1)))
    conditions = tuples_of(expressions(2), most=2)
    return ast.FunDef(
        *head, draw(st.sampled_from(ast.External)), draw(conditions), draw(conditions)
    )


@st.composite
def contracts(draw: Callable[[SearchStrategy[Any]], Any]) -> ast.ContractDef:
    """Contracts of at least one line."""
    requires = draw(tuples_of(expressions(2), most=2))
    ensures = draw(tuples_of(expressions(2), least=0 if requires else 1, most=2))
    return ast.ContractDef(draw(idents), requires, ensures)


@lazily
def sections(*, agents: bool = True) -> SearchStrategy[ast.Section]:
    """Sections of a file, or of an agent."""
    decls = tuples_of(declarations())
    name = st.none() | idents
    condition = expressions()
    found: SearchStrategy[ast.Section] = st.one_of(
        st.builds(ast.VarSection, st.sampled_from(ast.VarKind), decls),
        st.builds(ast.ParamDecl, declarations()),
        st.builds(ast.RecordDef, idents, tuples_of(declarations(), least=1)),
        st.builds(ast.EnumDef, idents, tuples_of(idents, least=1)),
        functions(),
        st.builds(
            ast.Using, idents, decls, decls, st.none() | blocks(1), tuples_of(contracts(), most=2)
        ),
        st.builds(ast.Init, blocks()),
        st.builds(ast.Event, idents, st.booleans(), st.none() | condition, blocks()),
        st.builds(ast.Assume, name, condition),
        st.builds(ast.Invariant, name, st.booleans(), condition),
        st.builds(ast.Eventually, name, condition),
        st.builds(ast.LeadsTo, name, condition, condition, st.booleans()),
    )
    if not agents:
        return found
    return found | st.builds(ast.Agent, idents, tuples_of(sections(agents=False), least=1, most=2))


@lazily
def programs() -> SearchStrategy[ast.Program]:
    """Whole programs."""
    return st.builds(ast.Program, tuples_of(sections(), most=4))
