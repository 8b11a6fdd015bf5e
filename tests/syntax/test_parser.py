"""What every form of the language is read as."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest
from msgspec import Struct

import koord
from koord.syntax import ast
from koord.syntax.parsing.parser import parse
from koord.syntax.source import NOWHERE, Source
from tests import strategies
from tests.syntax.reading import effect, expression, program, section, statement

X, Y, Z = (ast.Name(name) for name in "xyz")
ONE, TWO = ast.IntLit(1), ast.IntLit(2)
INT, POS = ast.NamedType("int"), ast.NamedType("pos")


def ident(name: str) -> ast.Ident:
    return ast.Ident(name)


def binary(op: str, left: ast.Expr, right: ast.Expr) -> ast.Binary:
    return ast.Binary(ast.BinaryOp(op), left, right)


def call(name: str, *values: ast.Expr) -> ast.Call:
    return ast.Call(ident(name), tuple(ast.Argument(None, value) for value in values))


def forall(body: ast.Expr, *binders: ast.Binder) -> ast.Quantified:
    return ast.Quantified(ast.Quantifier.FORALL, binders, body)


def bound(
    *names: str,
    low: ast.Expr | None = None,
    high: ast.Expr | None = None,
    over: ast.Expr | None = None,
) -> ast.Binder:
    return ast.Binder(tuple(map(ident, names)), low=low, high=high, over=over)


# --- expressions --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("42", ast.IntLit(42)),
        ("2.5", ast.FloatLit(Fraction(5, 2))),
        ("1e-3", ast.FloatLit(Fraction(1, 1000))),
        ("1.5E2", ast.FloatLit(Fraction(150))),
        ("true", ast.BoolLit(True)),
        ("False", ast.BoolLit(False)),
        (r'"a\"b\\\n\t/#"', ast.StringLit('a"b\\\n\t/#')),
        ('"ü"', ast.StringLit("ü")),
        ("[]", ast.ListLit(())),
        ("[x, 1]", ast.ListLit((X, ONE))),
        ("{}", ast.MapLit(())),
        ("{x, 1}", ast.SetLit((X, ONE))),
        ("{x: 1, y: 2}", ast.MapLit(((X, ONE), (Y, TWO)))),
        ("(x)", X),
        ("f()", call("f")),
        ("f(x, 1)", call("f", X, ONE)),
        (
            "Task(loc = x, 1)",
            ast.Call(ident("Task"), (ast.Argument("loc", X), ast.Argument(None, ONE))),
        ),
        ("x.f", ast.Attribute(X, ident("f"))),
        ("x.f(1)", ast.MethodCall(X, ident("f"), (ast.Argument(None, ONE),))),
        ("x[1][y]", ast.Index(ast.Index(X, ONE), Y)),
        ("x@y", ast.AtRobot(X, Y)),
        ("x@0", ast.AtRobot(X, ast.IntLit(0))),
        ("x@(y + 1)", ast.AtRobot(X, binary("+", Y, ONE))),
        ("x.f@y.g", ast.Attribute(ast.AtRobot(ast.Attribute(X, ident("f")), Y), ident("g"))),
        ("ran(E)@y", ast.AtRobot(call("ran", ast.Name("E")), Y)),
        ("x'", ast.Prime(X)),
        ("x[1]'", ast.Prime(ast.Index(X, ONE))),
        ("x'.f", ast.Attribute(ast.Prime(X), ident("f"))),
        ("-x", ast.Unary(ast.UnaryOp.NEG, X)),
        ("not x", ast.Unary(ast.UnaryOp.NOT, X)),
        ("!x", ast.Unary(ast.UnaryOp.NOT, X)),
        ("x - -1", binary("-", X, ast.Unary(ast.UnaryOp.NEG, ONE))),
    ],
)
def test_operands(text: str, meant: ast.Expr) -> None:
    assert expression(text) == meant


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("x + y * z", "x + (y * z)"),
        ("x - y - z", "(x - y) - z"),
        ("x / y % z * x", "((x / y) % z) * x"),
        ("-x * y", "(-x) * y"),
        ("-x.f[1]", "-((x.f)[1])"),
        ("x + y < z - 1", "(x + y) < (z - 1)"),
        ("not x == y and z", "(not (x == y)) and z"),
        ("x == not y", "x == (not y)"),
        ("x == not y and z", "(x == (not y)) and z"),
        ("not not x", "not (not x)"),
        ("x and y or z and x", "(x and y) or (z and x)"),
        ("x or y implies z or x", "(x or y) implies (z or x)"),
        ("x implies y implies z", "x implies (y implies z)"),
        ("x and forall i: y and z", "x and (forall i: (y and z))"),
        ("not forall i: x or y", "not (forall i: (x or y))"),
        ("forall i: exists j: x", "forall i: (exists j: x)"),
        ("x && y || !z", "(x and y) or (not z)"),
        ("x ≠ y", "x != y"),
        ("x ≤ y and y ≥ z", "(x <= y) and (y >= z)"),
        ("x<y", "x < y"),
        ("(x +\n   y) *\n (z)", "(x + y) * z"),
    ],
)
def test_how_tightly_operators_bind(text: str, grouped: str) -> None:
    assert expression(f"({text})") == expression(grouped)
    assert expression(text.replace("\n", "")) == expression(grouped)


@pytest.mark.parametrize("op", list(ast.BinaryOp))
def test_every_operator(op: ast.BinaryOp) -> None:
    assert expression(f"x {op.value} y") == ast.Binary(op, X, Y)


@pytest.mark.parametrize(
    ("binders", "meant"),
    [
        ("i", (bound("i"),)),
        ("i, j", (bound("i", "j"),)),
        ("k in 0, x", (bound("k", low=ast.IntLit(0), high=X),)),
        ("k = 0, x", (bound("k", low=ast.IntLit(0), high=X),)),
        ("t in x", (bound("t", over=X),)),
        ("t in x.f", (bound("t", over=ast.Attribute(X, ident("f"))),)),
        ("i, k in 1, 2", (bound("i", "k", low=ONE, high=TWO),)),
        ("k in 1, 2, i", (bound("k", low=ONE, high=TWO), bound("i"))),
        ("t in x, u in y", (bound("t", over=X), bound("u", over=Y))),
        ("Car c", (ast.Binder((ident("c"),), type=ast.NamedType("Car")),)),
        ("pos p, q", (ast.Binder((ident("p"), ident("q")), type=POS),)),
        (
            "pos p, int k",
            (ast.Binder((ident("p"),), type=POS), ast.Binder((ident("k"),), type=INT)),
        ),
        ("pos[] p", (ast.Binder((ident("p"),), type=ast.ArrayTypeExpr(POS, None)),)),
        (
            "Map<int, pos[]> m",
            (
                ast.Binder(
                    (ident("m"),),
                    type=ast.NamedType("Map", (INT, ast.ArrayTypeExpr(POS, None))),
                ),
            ),
        ),
    ],
)
def test_what_quantifiers_bind(binders: str, meant: tuple[ast.Binder, ...]) -> None:
    assert expression(f"forall {binders}: x") == forall(X, *meant)
    assert expression(f"(exists {binders}: x)") == ast.Quantified(ast.Quantifier.EXISTS, meant, X)


def test_colons_of_quantifiers_maps_and_blocks_are_told_apart() -> None:
    head = "if forall i: x == {1: 2}[i] and (exists j: y): x = 1"
    (found,) = effect(head)
    assert isinstance(found, ast.If)
    assert found.arms[0][1] == (ast.Assign(X, ONE),)
    assert isinstance(found.arms[0][0], ast.Quantified)


# --- types and declarations ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("int v", INT),
        ("pos[] v", ast.ArrayTypeExpr(POS, None)),
        ("pos v[]", ast.ArrayTypeExpr(POS, None)),
        ("pos[3] v", ast.ArrayTypeExpr(POS, ast.IntLit(3))),
        ("pos v[Nsys]", ast.ArrayTypeExpr(POS, ast.Name("Nsys"))),
        ("pos[][] v", ast.ArrayTypeExpr(ast.ArrayTypeExpr(POS, None), None)),
        ("pos[] v[2]", ast.ArrayTypeExpr(ast.ArrayTypeExpr(POS, None), TWO)),
        ("pos v[1][2]", ast.ArrayTypeExpr(ast.ArrayTypeExpr(POS, TWO), ONE)),
        ("List<int> v", ast.NamedType("List", (INT,))),
        ("Queue<pos[]> v", ast.NamedType("Queue", (ast.ArrayTypeExpr(POS, None),))),
        ("Map<int,List<pos>> v", ast.NamedType("Map", (INT, ast.NamedType("List", (POS,))))),
        (
            "Map<int, List<List<pos>>>[] v",
            ast.ArrayTypeExpr(
                ast.NamedType(
                    "Map", (INT, ast.NamedType("List", (ast.NamedType("List", (POS,)),)))
                ),
                None,
            ),
        ),
    ],
)
def test_types(text: str, meant: ast.TypeExpr) -> None:
    plain, initialised = ast.VarDecl(meant, ident("v")), ast.VarDecl(meant, ident("v"), X)
    kinds = (ast.VarKind.LOCAL, ast.VarKind.ALLREAD, ast.VarKind.ALLWRITE)
    for kind in kinds:
        assert section(f"{kind.value}:\n  {text}\n  {text} = x\n") == ast.VarSection(
            kind, (plain, initialised)
        )
    assert section(f"param {text} = x") == ast.ParamDecl(initialised)
    assert section(f"def R:\n  {text}\n") == ast.RecordDef(ident("R"), (plain,))
    assert section(f"def adt R:\n  {text}\n") == ast.RecordDef(ident("R"), (plain,))
    assert section(f"using M:\n  sensors:\n    {text}\n") == ast.Using(
        ident("M"), (plain,), (), None, ()
    )
    assert section(f"def fun f({text}, {text}): {text}") == ast.FunDef(
        ident("f"), (plain, plain), None, (ast.LocalDecl(plain),)
    )
    assert effect(f"{text}\n{text} = x") == (ast.LocalDecl(plain), ast.LocalDecl(initialised))


# --- statements ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("x = 1", ast.Assign(X, ONE)),
        ("x=1", ast.Assign(X, ONE)),
        ("x[y] = 1", ast.Assign(ast.Index(X, Y), ONE)),
        ("x.f[1].g = y", None),
        ("x++", ast.Increment(X, 1)),
        ("x[1]--", ast.Increment(ast.Index(X, ONE), -1)),
        ("break", ast.Break()),
        ("return", ast.Return(None)),
        ("return x + 1", ast.Return(binary("+", X, ONE))),
        ("stop", ast.Stop()),
        ("stop()", ast.Stop()),
        ("trystop()", ast.TryStop()),
        ("trystop", ast.TryStop()),
        ("pass", ast.Pass()),
        ("f(x)", ast.CallStmt(call("f", X))),
        ("x.f(1)", ast.CallStmt(ast.MethodCall(X, ident("f"), (ast.Argument(None, ONE),)))),
        ("stdout << x", ast.Output(ast.Name("stdout"), (X,))),
        ("x.f << 1 + 2 << y", None),
        ("if x: stop", ast.If(((X, (ast.Stop(),)),), None)),
        ("for x = 1, y: stop", ast.ForRange(ident("x"), ONE, Y, (ast.Stop(),))),
        ("for x in y: stop", ast.ForEach((ident("x"),), Y, (ast.Stop(),))),
        ("for x, y in z: stop", ast.ForEach((ident("x"), ident("y")), Z, (ast.Stop(),))),
        ("repeat y: stop", ast.Repeat(Y, (ast.Stop(),))),
        ("atomic: stop", ast.Atomic((ast.Stop(),))),
    ],
)
def test_statements(text: str, meant: ast.Stmt | None) -> None:
    found = statement(text)
    if meant:
        assert found == meant
    elif isinstance(found, ast.Output):
        assert found.values == (binary("+", ONE, TWO), Y)
    else:
        target = ast.Attribute(ast.Index(ast.Attribute(X, ident("f")), ONE), ident("g"))
        assert found == ast.Assign(target, Y)


def test_the_arms_of_if() -> None:
    assert statement("if x:\n  x = 1\nelif y: y = 1\nelse:\n  z = 1") == ast.If(
        ((X, (ast.Assign(X, ONE),)), (Y, (ast.Assign(Y, ONE),))), (ast.Assign(Z, ONE),)
    )


# --- sections -----------------------------------------------------------------------------------


def test_events() -> None:
    stop = (ast.Stop(),)
    assert section("Go:\n  pre: x\n  eff: stop\n") == ast.Event(ident("Go"), False, X, stop)
    assert section("go:\n  eff: stop\n") == ast.Event(ident("go"), False, None, stop)
    assert section("urgent GO:\n  eff: stop\n  pre:\n    x\n") == ast.Event(
        ident("GO"), True, X, stop
    )


def test_modules() -> None:
    decl = ast.VarDecl(INT, ident("v"))
    text = """
        using module Heater:
          actuators:
            int v
          sensors:
          environment: x = 1
          contract Warm:
            requires: x
              y
            ensures:
              x' > 1
          contract Other:
            ensures: y
    """
    contracts = (
        ast.ContractDef(ident("Warm"), (X, Y), (binary(">", ast.Prime(X), ONE),)),
        ast.ContractDef(ident("Other"), (), (Y,)),
    )
    assert section(text) == ast.Using(
        ident("Heater"), (), (decl,), (ast.Assign(X, ONE),), contracts
    )
    empty = ast.Using(ident("Motion"), (), (), None, ())
    for short in ("using Motion", "using Motion:", "using module Motion"):
        assert section(short) == empty
    assert section("using module") == ast.Using(ident("module"), (), (), None, ())


def test_functions() -> None:
    parameters = (
        ast.VarDecl(INT, ident("a")),
        ast.VarDecl(ast.ArrayTypeExpr(POS, None), ident("b")),
    )
    body = (ast.LocalDecl(ast.VarDecl(INT, ident("best"), ONE)), ast.Return(ast.Name("best")))
    head = "fun f(int a, pos[] b) -> int:"
    made = ast.FunDef(ident("f"), parameters, INT, body)
    assert section(f"def {head}\n  int best = 1\n  return best\n") == made
    assert section("def f(int a,\n  pos b[]) -> int:\n  int best = 1\n  return best\n") == made
    for body_, kind in (("extern", ast.External.FUNCTION), ("extern fresh", ast.External.FRESH)):
        text = f"def {head} {body_}\n  requires: x\n  ensures: y\n  ensures: z\n"
        external = ast.FunDef(ident("f"), parameters, INT, kind, (X,), (Y, Z))
        assert section(text) == external
        assert section(text.replace(f" {body_}", f"\n  {body_}")) == external
    assert section("def fun f() -> int: extern") == ast.FunDef(
        ident("f"), (), INT, ast.External.FUNCTION
    )
    assert section("def fun fun(): return") == ast.FunDef(
        ident("fun"), (), None, (ast.Return(None),)
    )


@pytest.mark.parametrize("text", ["a, b", "\n  a,\n  b", "\n  a\n  b", "a,\n  b"])
def test_enumerations(text: str) -> None:
    assert section(f"enum Mode: {text}\n") == ast.EnumDef(ident("Mode"), (ident("a"), ident("b")))


def test_init_and_agents() -> None:
    init = ast.Init((ast.Assign(X, ONE),))
    event = ast.Event(ident("E"), False, None, (ast.Stop(),))
    assert program("agent Car:\n  init: x = 1\n  E:\n    eff: stop\ninit:\n  x = 1\n").sections == (
        ast.Agent(ident("Car"), (init, event)),
        init,
    )


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("assume: x", ast.Assume(None, X)),
        ("assume N: x", ast.Assume(ident("N"), X)),
        ("invariant: x", ast.Invariant(None, False, X)),
        ("invariant N: x", ast.Invariant(ident("N"), False, X)),
        ("invariant N at round: x", ast.Invariant(ident("N"), True, X)),
        ("invariant at round: x", ast.Invariant(None, True, X)),
        ("invariant at: x", ast.Invariant(ident("at"), False, X)),
        ("invariant round at round: x", ast.Invariant(ident("round"), True, X)),
        ("eventually N: x", ast.Eventually(ident("N"), X)),
        ("eventually: x", ast.Eventually(None, X)),
        ("eventually N: x leadsto y", ast.LeadsTo(ident("N"), X, Y)),
        ("eventually:\n  x\n  leadsto y", ast.LeadsTo(None, X, Y)),
        ("assume N: x leadsto y", ast.LeadsTo(ident("N"), X, Y, assumed=True)),
        (
            "eventually: forall i: x leadsto y",
            ast.LeadsTo(None, forall(X, bound("i")), Y),
        ),
    ],
)
def test_properties(text: str, meant: ast.Section) -> None:
    assert section(text) == meant


@pytest.mark.parametrize("word", strategies.WORDS)
def test_words_that_are_also_names(word: str) -> None:
    name = ast.Name(word)
    decl = ast.VarDecl(INT, ident(word), ONE)
    assert section(f"local:\n  int {word} = 1\n") == ast.VarSection(ast.VarKind.LOCAL, (decl,))
    assert statement(f"{word} = {word} + {word}[1]") == ast.Assign(
        name, binary("+", name, ast.Index(name, ONE))
    )
    assert statement(f"{word}({word})") == ast.CallStmt(call(word, name))
    increment = ast.Increment(ast.Attribute(name, ident(word)), 1)
    assert statement(f"if {word} < {word}: {word}.{word}++") == ast.If(
        ((binary("<", name, name), (increment,)),), None
    )
    assert expression(f"forall {word}: {word}@{word}") == forall(
        ast.AtRobot(name, name), bound(word)
    )
    event = ast.Event(ident(word), False, name, (ast.Increment(name, 1),))
    assert section(f"{word}:\n  pre: {word}\n  eff: {word}++\n") == event
    assert section(f"def {word}:\n  int {word} = 1\n") == ast.RecordDef(ident(word), (decl,))
    assert section(f"enum {word}: {word}") == ast.EnumDef(ident(word), (ident(word),))


# --- places and comments ------------------------------------------------------------------------


def spans(node: object) -> None:
    """Every node has a place, within that of its parent's line range."""
    if isinstance(node, tuple):
        for item in node:
            spans(item)
    elif isinstance(node, ast.Node):
        assert node.span.file != NOWHERE.file, node
        assert (node.span.line, node.span.column) < (node.span.end_line, node.span.end_column)
        for name in node.__struct_fields__:
            child = getattr(node, name)
            if isinstance(child, ast.Node):
                assert node.span.line <= child.span.line
                assert child.span.end_line <= node.span.end_line, (node, child)
            spans(child)
    else:
        assert not isinstance(node, Struct) or isinstance(node, ast.Comment) or field_free(node)


def field_free(node: object) -> bool:
    return type(node).__name__ == "Span"


def test_every_node_has_its_place() -> None:
    prelude = Path(koord.__file__).parent / "syntax" / "prelude.krd"
    parsed = parse(Source("prelude", prelude.read_text(encoding="utf-8")))
    assert parsed.diagnostics == ()
    spans(parsed.program.sections)


@pytest.mark.parametrize(
    ("text", "piece"),
    [
        ("x + y * z", "x + y * z"),
        ("(x + y)", "(x + y)"),
        ("f(x, [y])", "f(x, [y])"),
        ("-x.f[1]", "-x.f[1]"),
        ("x'", "x'"),
        ("forall i: x@i", "forall i: x@i"),
        ('"a b"', '"a b"'),
        ("Task(loc = x)", "Task(loc = x)"),
    ],
)
def test_places_are_exact(text: str, piece: str) -> None:
    span = expression(text).span
    assert (span.line, span.column, span.end_column) == (1, 12, 12 + len(piece))


def test_comments_are_kept_beside_the_tree() -> None:
    text = "// one\nlocal: # two\n  int x // three # four\n\n# five"
    assert [(c.line, c.column, c.text, c.own_line) for c in program(text).comments] == [
        (1, 1, "// one", True),
        (2, 8, "# two", False),
        (3, 9, "// three # four", False),
        (5, 1, "# five", True),
    ]


def test_marks_of_comments_in_strings_are_text() -> None:
    found = program('E:\n  eff: stdout << "# // no" // yes\n')
    assert [c.text for c in found.comments] == ["// yes"]


EXAMPLES = sorted(Path(koord.__file__).parents[1].glob("specs/examples/**/*.krd"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_read(path: Path) -> None:
    assert parse(Source(path.name, path.read_text(encoding="utf-8"))).diagnostics == ()
