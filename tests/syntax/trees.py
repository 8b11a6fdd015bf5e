"""Random trees of programs, sensible or not, over few names so that names meet."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import strategies as st

from koord.syntax import ast


def _words(text: str) -> st.SearchStrategy[str]:
    return st.sampled_from(text.split())


WORDS = _words(
    """a b n x p list task route Task Mode idle Motion psn target position Clock now stdout pid
    numAgents delta Go Stop f g Car Drone result stopped loc assigned z ? pos"""
)
CALLS = _words(
    """f g length append remove pop assign choose ran min max any all abs toList contains
    findPath midpoint getNeighbors pathIsClear Task pos sqrt allAssigned Car distance merge"""
)
TYPE_NAMES = _words("""int float bool string pos stream Task Mode Car Drone List Queue Map Other""")

idents = st.builds(ast.Ident, WORDS)


def _types() -> st.SearchStrategy[ast.TypeExpr]:
    plain = st.builds(ast.NamedType, TYPE_NAMES)
    sizes = st.none() | st.builds(ast.IntLit, st.integers(-1, 3)) | st.builds(ast.Name, WORDS)
    return st.recursive(
        plain,
        lambda inner: (
            st.builds(ast.ArrayTypeExpr, inner, sizes)
            | st.builds(ast.NamedType, TYPE_NAMES, st.lists(inner, max_size=2).map(tuple))
        ),
        max_leaves=4,
    )


types = _types()


def _composed(inner: st.SearchStrategy[ast.Expr]) -> st.SearchStrategy[ast.Expr]:
    named = st.builds(ast.Argument, st.none() | WORDS, inner)
    arguments = st.lists(named, max_size=3).map(tuple)
    binder = st.builds(
        ast.Binder,
        st.lists(idents, min_size=1, max_size=2).map(tuple),
        low=st.none() | inner,
        high=st.none() | inner,
        over=st.none() | inner,
        type=st.none() | types,
    )
    return st.one_of(
        st.builds(ast.Attribute, inner, idents),
        st.builds(ast.Index, inner, inner),
        st.builds(ast.Binary, st.sampled_from(ast.BinaryOp), inner, inner),
        st.builds(ast.Unary, st.sampled_from(ast.UnaryOp), inner),
        st.builds(ast.Call, st.builds(ast.Ident, CALLS), arguments),
        st.builds(ast.MethodCall, inner, st.builds(ast.Ident, CALLS), arguments),
        st.builds(ast.AtRobot, inner, inner),
        st.builds(ast.Prime, inner),
        st.builds(ast.ListLit, st.lists(inner, max_size=3).map(tuple)),
        st.builds(ast.SetLit, st.lists(inner, min_size=1, max_size=2).map(tuple)),
        st.builds(ast.MapLit, st.lists(st.tuples(inner, inner), max_size=2).map(tuple)),
        st.builds(
            ast.Quantified,
            st.sampled_from(ast.Quantifier),
            st.lists(binder, min_size=1, max_size=2).map(tuple),
            inner,
        ),
    )


expressions: st.SearchStrategy[ast.Expr] = st.recursive(
    st.one_of(
        st.builds(ast.Name, WORDS),
        st.builds(ast.IntLit, st.integers(0, 5)),
        st.builds(ast.FloatLit, st.sampled_from([Fraction(1, 2), Fraction(0)])),
        st.builds(ast.BoolLit, st.booleans()),
        st.builds(ast.StringLit, st.just("text")),
    ),
    _composed,
    max_leaves=8,
)

decls = st.builds(ast.VarDecl, types, idents, st.none() | expressions)
_calls = st.builds(
    ast.Call,
    st.builds(ast.Ident, CALLS),
    st.lists(st.builds(ast.Argument, st.none(), expressions), max_size=3).map(tuple),
)


def _blocks(inner: st.SearchStrategy[ast.Stmt]) -> st.SearchStrategy[ast.Stmt]:
    block = st.lists(inner, max_size=3).map(tuple)
    arms = st.lists(st.tuples(expressions, block), min_size=1, max_size=2).map(tuple)
    return st.one_of(
        st.builds(ast.If, arms, st.none() | block),
        st.builds(ast.ForRange, idents, expressions, expressions, block),
        st.builds(
            ast.ForEach,
            st.lists(idents, min_size=1, max_size=2).map(tuple),
            expressions,
            block,
        ),
        st.builds(ast.Repeat, expressions, block),
        st.builds(ast.Atomic, block),
    )


statements: st.SearchStrategy[ast.Stmt] = st.recursive(
    st.one_of(
        st.builds(ast.Assign, expressions, expressions),
        st.builds(ast.Increment, expressions, st.sampled_from([1, -1])),
        st.builds(ast.CallStmt, _calls),
        st.builds(ast.Output, expressions, st.lists(expressions, max_size=2).map(tuple)),
        st.builds(ast.LocalDecl, decls),
        st.builds(ast.Return, st.none() | expressions),
        st.sampled_from([ast.Break(), ast.Stop(), ast.TryStop(), ast.Pass()]),
    ),
    _blocks,
    max_leaves=5,
)

blocks = st.lists(statements, max_size=4).map(tuple)
_some = st.lists(expressions, max_size=2).map(tuple)
_decl_list = st.lists(decls, max_size=4).map(tuple)
_contracts = st.lists(st.builds(ast.ContractDef, idents, _some, _some), max_size=2).map(tuple)
_functions = st.builds(
    ast.FunDef,
    st.builds(ast.Ident, CALLS),
    st.lists(st.builds(ast.VarDecl, types, idents), max_size=3).map(tuple),
    st.none() | types,
    blocks | st.sampled_from(ast.External),
    _some,
    _some,
)


def _sections() -> st.SearchStrategy[ast.Section]:
    named = st.none() | idents
    plain = st.one_of(
        st.builds(ast.VarSection, st.sampled_from(ast.VarKind), _decl_list),
        st.builds(ast.ParamDecl, decls),
        st.builds(ast.RecordDef, st.builds(ast.Ident, TYPE_NAMES), _decl_list),
        st.builds(
            ast.EnumDef,
            st.builds(ast.Ident, TYPE_NAMES),
            st.lists(idents, max_size=3).map(tuple),
        ),
        _functions,
        st.builds(ast.Using, idents, _decl_list, _decl_list, st.none() | blocks, _contracts),
        st.builds(ast.Init, blocks),
        st.builds(ast.Event, idents, st.booleans(), st.none() | expressions, blocks),
        st.builds(ast.Assume, named, expressions),
        st.builds(ast.Invariant, named, st.booleans(), expressions),
        st.builds(ast.Eventually, named, expressions),
        st.builds(ast.LeadsTo, named, expressions, expressions, st.booleans()),
    )
    return plain | st.builds(
        ast.Agent,
        st.builds(ast.Ident, st.sampled_from(["Car", "Drone"])),
        st.lists(plain, max_size=3).map(tuple),
    )


programs = st.builds(ast.Program, st.lists(_sections(), max_size=8).map(tuple))
