"""Elaboration is total: any tree gets diagnostics or a well-formed core program."""

from __future__ import annotations

import re
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from koord.syntax import ast
from koord.syntax.diagnostics import Severity
from koord.syntax.elaboration import Elaborated, elaborate
from koord.syntax.parsing.parser import parse
from koord.syntax.source import Source
from tests.generators.wellformed import complaints
from tests.sampling import examples
from tests.syntax.trees import programs

ROOT = Path(__file__).resolve().parents[2]
TEXTS = [
    path.read_text(encoding="utf-8")
    for path in (
        *sorted((ROOT / "specs" / "examples").glob("*.krd")),
        ROOT / "koord" / "syntax" / "prelude.krd",
        ROOT / "tests" / "syntax" / "golden" / "task_as_printed.krd",
    )
]
TOKEN = re.compile(r"\n *|[A-Za-z_]\w*|\d+(?:\.\d+)?|\S| +")
VOCABULARY = sorted({token for text in TEXTS for token in TOKEN.findall(text)})


def check(elaborated: Elaborated) -> None:
    """What must hold of any answer."""
    errors = [d for d in elaborated.diagnostics if d.severity is Severity.ERROR]
    if elaborated.program is not None:
        assert errors == []
        assert complaints(elaborated.program) == []
    places = [(d.code, d.span) for d in elaborated.diagnostics]
    assert len(places) == len(set(places))


@examples(150)
@given(programs)
def test_any_tree_is_elaborated(program: ast.Program) -> None:
    check(elaborate(program))


@examples(150)
@given(st.data())
def test_any_mistyped_text_is_elaborated(data: st.DataObject) -> None:
    tokens = TOKEN.findall(data.draw(st.sampled_from(TEXTS)))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(tokens) - 1))
        change = data.draw(st.integers(0, 2))
        new = [] if change == 0 else [data.draw(st.sampled_from(VOCABULARY))]
        tokens[place : place + (0 if change == 1 else 1)] = new
    check(elaborate(parse(Source("a.krd", "".join(tokens))).program))


def test_deep_trees_are_refused_and_not_fatal() -> None:
    deep: ast.Expr = ast.Name("a")
    chain: ast.Expr = ast.Name("a")
    types: ast.TypeExpr = ast.NamedType("int")
    nested: tuple[ast.Stmt, ...] = ()
    for _ in range(20_000):
        deep = ast.Binary(ast.BinaryOp.ADD, deep, ast.IntLit(1))
        chain = ast.Attribute(chain, ast.Ident("x"))
        types = ast.ArrayTypeExpr(types, None)
        nested = (ast.Atomic(nested),)
    append = ast.Call(ast.Ident("append"), (ast.Argument(None, chain), ast.Argument(None, deep)))
    sections: tuple[ast.Section, ...] = (
        ast.VarSection(ast.VarKind.LOCAL, (ast.VarDecl(types, ast.Ident("a"), deep),)),
        ast.RecordDef(ast.Ident("R"), (ast.VarDecl(types, ast.Ident("f")),)),
        ast.Event(ast.Ident("Go"), False, deep, (ast.Assign(chain, append), ast.CallStmt(append))),
        ast.Event(ast.Ident("In"), False, None, nested),
        ast.Invariant(None, False, chain),
    )
    found = elaborate(ast.Program(sections))
    assert "K231" in {d.code for d in found.diagnostics}
    assert found.program is None
    elifs = tuple((ast.BoolLit(True), (ast.Pass(),)) for _ in range(20_000))
    event = ast.Event(ast.Ident("Go"), False, None, (ast.If(elifs, None),))
    assert [d.code for d in elaborate(ast.Program((event,))).diagnostics] == ["K231"]
