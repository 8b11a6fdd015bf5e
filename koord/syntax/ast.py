"""The abstract syntax of Koord, as written: names unresolved, types unchecked.

Spans do not take part in equality, so that two texts with the same structure parse to equal trees:
the law behind the printer, ``parse(print(parse(t))) == parse(t)``. Where two spellings were
published, both parse to one node; the printer writes the preferred one.
"""

from __future__ import annotations

from enum import Enum
from fractions import Fraction
from typing import ClassVar

from msgspec import Struct

from koord.syntax.source import Placed


class Node(Placed, frozen=True):
    """A node of the syntax tree, with its place in the text."""


# --- names and types ----------------------------------------------------------------------------


class Ident(Node, frozen=True):
    """A name where it is declared, or where a label needs its own place."""

    name: str


class NamedType(Node, frozen=True):
    """``int``, ``pos``, ``Task``, …; ``List<T>``, ``Queue<T>``, ``Map<K,V>`` carry arguments."""

    name: str
    arguments: tuple[TypeExpr, ...] = ()


class ArrayTypeExpr(Node, frozen=True):
    """``T[]`` (``size`` is None) or ``T[k]``, where the size is a constant expression."""

    element: TypeExpr
    size: Expr | None


TypeExpr = NamedType | ArrayTypeExpr


# --- expressions --------------------------------------------------------------------------------


class UnaryOp(Enum):
    """Operators with one operand."""

    NEG = "-"
    NOT = "not"


class BinaryOp(Enum):
    """Operators with two operands; ``≠ ≤ ≥ && ||`` are read as the spellings here."""

    ADD = "+"
    SUB = "-"
    MUL = "*"
    DIV = "/"
    MOD = "%"
    EQ = "=="
    NE = "!="
    LT = "<"
    LE = "<="
    GT = ">"
    GE = ">="
    AND = "and"
    OR = "or"
    IMPLIES = "implies"


class Quantifier(Enum):
    """``forall`` and ``exists``."""

    FORALL = "forall"
    EXISTS = "exists"


class IntLit(Node, frozen=True):
    """``42``"""

    value: int


class FloatLit(Node, frozen=True):
    """``2.5``, ``1e-3``: kept exactly; the printer writes a decimal that reads back to it."""

    value: Fraction


class BoolLit(Node, frozen=True):
    """``true``, ``false`` (also ``True``, ``False``)."""

    value: bool


class StringLit(Node, frozen=True):
    """``"text"``; ``value`` is the text meant, with escapes resolved."""

    value: str


class Name(Node, frozen=True):
    """A variable, constant, enumeration member, port, ``pid``, ``numAgents`` …"""

    name: str


class ListLit(Node, frozen=True):
    """``[a, b]``"""

    items: tuple[Expr, ...]


class MapLit(Node, frozen=True):
    """``{}`` or ``{k: v, …}``"""

    entries: tuple[tuple[Expr, Expr], ...]


class SetLit(Node, frozen=True):
    """``{a, b}``; the set of no elements is written ``{}``, a :class:`MapLit`."""

    items: tuple[Expr, ...]


Collection = ListLit | MapLit | SetLit


class Unary(Node, frozen=True):
    """``-e``, ``not e``"""

    op: UnaryOp
    operand: Expr


class Binary(Node, frozen=True):
    """``a + b``; comparison does not chain."""

    op: BinaryOp
    left: Expr
    right: Expr


class Argument(Node, frozen=True):
    """An argument of a call; ``name`` is set for ``f(name = value)``."""

    name: str | None
    value: Expr


class Call(Node, frozen=True):
    """``f(a, b)`` or ``Task(loc = p)``."""

    function: Ident
    arguments: tuple[Argument, ...]


class MethodCall(Node, frozen=True):
    """``x.append(v)``"""

    receiver: Expr
    method: Ident
    arguments: tuple[Argument, ...]


class Index(Node, frozen=True):
    """``x[i]``"""

    base: Expr
    index: Expr


class Attribute(Node, frozen=True):
    """``x.f``: a field of a record, a port of a module, or a member of an enumeration."""

    base: Expr
    name: Ident


class AtRobot(Node, frozen=True):
    """``v@i``, ``ran(E)@i``, ``Motion.psn@i``: the value at robot ``i``."""

    base: Expr
    robot: Expr


class Prime(Node, frozen=True):
    """``x'``: the value after a step."""

    base: Expr


class Binder(Node, frozen=True):
    """Bound names of a quantifier that share one range.

    ``i, j`` (over robots: no range, no type), ``k in 0, n`` (from 0 up to and excluding n; also
    ``k = 0, n``), ``t in list`` (``low`` is None), or ``pos p`` (every value of a type; summaries
    of external functions only).
    """

    names: tuple[Ident, ...]
    low: Expr | None = None
    high: Expr | None = None
    over: Expr | None = None
    type: TypeExpr | None = None


class Quantified(Node, frozen=True):
    """``forall i, j: body``"""

    quantifier: Quantifier
    binders: tuple[Binder, ...]
    body: Expr


Expr = (
    IntLit
    | FloatLit
    | BoolLit
    | StringLit
    | Name
    | ListLit
    | MapLit
    | SetLit
    | Unary
    | Binary
    | Call
    | MethodCall
    | Index
    | Attribute
    | AtRobot
    | Prime
    | Quantified
)


# --- statements ---------------------------------------------------------------------------------


class Assign(Node, frozen=True):
    """``target = value``; the target is a name, element, field or port."""

    target: Expr
    value: Expr


class Increment(Node, frozen=True):
    """``x++`` (``amount`` 1) or ``x--`` (``amount`` -1)."""

    target: Expr
    amount: int


class If(Node, frozen=True):
    """``if … elif … else``: each arm has a condition and a block; no ``else``, no ``otherwise``."""

    arms: tuple[tuple[Expr, Block], ...]
    otherwise: Block | None


class ForRange(Node, frozen=True):
    """``for i = low, high:`` from ``low`` up to and excluding ``high``."""

    variable: Ident
    low: Expr
    high: Expr
    body: Block


class ForEach(Node, frozen=True):
    """``for x in list:``, or ``for k, v in list:`` (index or key, and value)."""

    variables: tuple[Ident, ...]
    sequence: Expr
    body: Block


class Repeat(Node, frozen=True):
    """``repeat n:``, the body ``n`` times."""

    count: Expr
    body: Block


class Atomic(Node, frozen=True):
    """``atomic:``"""

    body: Block


class Break(Node, frozen=True):
    """``break``"""


class Return(Node, frozen=True):
    """``return e``"""

    value: Expr | None


class Stop(Node, frozen=True):
    """``stop`` (also ``stop()``)."""


class TryStop(Node, frozen=True):
    """``trystop()`` (also ``trystop``)."""


class Output(Node, frozen=True):
    """``stdout << a << b``: the stream, then what is written to it."""

    stream: Expr
    values: tuple[Expr, ...]


class LocalDecl(Node, frozen=True):
    """A variable declared inside a function body: ``int best = 0``."""

    decl: VarDecl


class Pass(Node, frozen=True):
    """``pass``: an effect that does nothing."""


class CallStmt(Node, frozen=True):
    """A call for its effect: ``append(x, v)``, ``x.remove(v)``, ``assign(t, pid)``."""

    call: Call | MethodCall


Stmt = (
    Assign
    | Increment
    | If
    | ForRange
    | ForEach
    | Repeat
    | Atomic
    | Break
    | Return
    | Stop
    | TryStop
    | Output
    | LocalDecl
    | Pass
    | CallStmt
)

Block = tuple[Stmt, ...]


# --- declarations -------------------------------------------------------------------------------


class VarDecl(Node, frozen=True):
    """``T x`` or ``T x = e``, wherever variables, ports and fields are declared.

    ``T x[n]`` is read as ``T[n] x``.
    """

    type: TypeExpr
    name: Ident
    initial: Expr | None = None


class VarKind(Enum):
    """The three homes of a variable."""

    ALLWRITE = "allwrite"
    ALLREAD = "allread"
    LOCAL = "local"


class VarSection(Node, frozen=True):
    """``local:``, ``allread:`` or ``allwrite:`` with its declarations."""

    kind: VarKind
    decls: tuple[VarDecl, ...]


class ParamDecl(Node, frozen=True):
    """``param int tasks = 4``: a constant of a run."""

    decl: VarDecl


class RecordDef(Node, frozen=True):
    """``def Task:`` or ``def adt Task:`` with its fields."""

    name: Ident
    fields: tuple[VarDecl, ...]


class EnumDef(Node, frozen=True):
    """``enum Mode: idle, pick, drop``"""

    name: Ident
    members: tuple[Ident, ...]


class External(Enum):
    """The kinds of external functions by their answers (decision record 0002)."""

    #: ``extern``: a mathematical function, equal answers for equal arguments.
    FUNCTION = "extern"
    #: ``extern fresh``: any value that the summary allows, a new one at each call.
    FRESH = "extern fresh"


class FunDef(Node, frozen=True):
    """``def fun f(int a, pos[] b) -> int:`` with a body, or external with its summary.

    ``requires`` and ``ensures`` are the lines so named below an external declaration; ``result``
    names the answer in them.
    """

    name: Ident
    parameters: tuple[VarDecl, ...]
    result: TypeExpr | None
    body: Block | External
    requires: tuple[Expr, ...] = ()
    ensures: tuple[Expr, ...] = ()


class ContractDef(Node, frozen=True):
    """``contract NAME:`` with ``requires:`` (ports before) and ``ensures:`` (primed: after)."""

    name: Ident
    requires: tuple[Expr, ...]
    ensures: tuple[Expr, ...]


class Using(Node, frozen=True):
    """``using Motion:`` with port lists, contracts and at most one ``environment:`` block.

    A module used without a body (``using Motion``) has the ports of the library's module.
    ``environment`` is None where there is no such block.
    """

    module: Ident
    sensors: tuple[VarDecl, ...]
    actuators: tuple[VarDecl, ...]
    environment: Block | None
    contracts: tuple[ContractDef, ...]


class Init(Node, frozen=True):
    """``init:``"""

    body: Block


class Event(Node, frozen=True):
    """``name:`` or ``urgent name:`` with ``pre:`` (None: always) and ``eff:``."""

    name: Ident
    urgent: bool
    pre: Expr | None
    eff: Block


class Assume(Node, frozen=True):
    """``assume: e`` about the initial configuration; ``assume NAME: e`` names it."""

    name: Ident | None
    condition: Expr


class Invariant(Node, frozen=True):
    """``invariant NAME: e``; with ``at round`` it is asked of round ends only."""

    name: Ident | None
    at_round: bool
    condition: Expr


class Eventually(Node, frozen=True):
    """``eventually NAME: e``"""

    name: Ident | None
    goal: Expr


class LeadsTo(Node, frozen=True):
    """``eventually NAME: p leadsto q``, or ``assume NAME: p leadsto q`` if it is ``assumed``"""

    name: Ident | None
    trigger: Expr
    goal: Expr
    assumed: bool = False


class Agent(Node, frozen=True):
    """``agent NAME:``: the modules, locals, init and events of one kind of robot."""

    name: Ident
    sections: tuple[Section, ...]


Section = (
    VarSection
    | ParamDecl
    | RecordDef
    | EnumDef
    | FunDef
    | Using
    | Init
    | Event
    | Assume
    | Invariant
    | Eventually
    | LeadsTo
    | Agent
)


class Comment(Struct, frozen=True):
    """A comment, for the printer. ``text`` keeps its ``//`` or ``#``."""

    line: int
    column: int
    text: str
    #: Whether the comment has its line for itself.
    own_line: bool


class Program(Node, frozen=True):
    """A file: its sections in order. Comments are kept beside the tree and not compared."""

    ASIDE: ClassVar[frozenset[str]] = frozenset({"span", "comments", "heads", "lost"})

    sections: tuple[Section, ...]
    comments: tuple[Comment, ...] = ()
    #: Where words stand that begin a block but have no node (``else``, ``pre``, ``sensors``, …),
    #: in the order of the text; for the printer, which puts comments beside them.
    heads: tuple[Ident, ...] = ()
    #: Names in what could not be read: they may have been declared or used there.
    lost: frozenset[str] = frozenset()
