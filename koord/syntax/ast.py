"""The abstract syntax of Koord, as written: names unresolved, types unchecked.

Spans do not take part in equality, so that two texts with the same structure parse to equal trees:
the law behind the printer, ``parse(print(parse(t))) == parse(t)``. Where two spellings were
published, both parse to one node; the printer writes the preferred one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction

from koord.syntax.source import NOWHERE, Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """Anything with a place."""

    span: Span = field(default=NOWHERE, compare=False, repr=False)


# --- names and types ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ident(Node):
    """A name where it is declared, or where a label needs its own place."""

    name: str


@dataclass(frozen=True, slots=True)
class NamedType(Node):
    """``int``, ``pos``, ``Task``, …; ``List<T>``, ``Queue<T>``, ``Map<K,V>`` carry arguments."""

    name: str
    arguments: tuple[TypeExpr, ...] = ()


@dataclass(frozen=True, slots=True)
class ArrayTypeExpr(Node):
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


@dataclass(frozen=True, slots=True)
class IntLit(Node):
    """``42``"""

    value: int


@dataclass(frozen=True, slots=True)
class FloatLit(Node):
    """``2.5``, ``1e-3``: kept exactly; the printer writes a decimal that reads back to it."""

    value: Fraction


@dataclass(frozen=True, slots=True)
class BoolLit(Node):
    """``true``, ``false`` (also ``True``, ``False``)."""

    value: bool


@dataclass(frozen=True, slots=True)
class StringLit(Node):
    """``"text"``; ``value`` is the text meant, with escapes resolved."""

    value: str


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A variable, constant, enumeration member, port, ``pid``, ``numAgents`` …"""

    name: str


@dataclass(frozen=True, slots=True)
class ListLit(Node):
    """``[a, b]``"""

    items: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class MapLit(Node):
    """``{}`` or ``{k: v, …}``"""

    entries: tuple[tuple[Expr, Expr], ...]


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """``-e``, ``not e``"""

    op: UnaryOp
    operand: Expr


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """``a + b``; comparison does not chain."""

    op: BinaryOp
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Argument(Node):
    """An argument of a call; ``name`` is set for ``f(name = value)``."""

    name: str | None
    value: Expr


@dataclass(frozen=True, slots=True)
class Call(Node):
    """``f(a, b)`` or ``Task(loc = p)``."""

    function: Ident
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class MethodCall(Node):
    """``x.append(v)``"""

    receiver: Expr
    method: Ident
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class Index(Node):
    """``x[i]``"""

    base: Expr
    index: Expr


@dataclass(frozen=True, slots=True)
class Attribute(Node):
    """``x.f``: a field of a record, a port of a module, or a member of an enumeration."""

    base: Expr
    name: Ident


@dataclass(frozen=True, slots=True)
class AtRobot(Node):
    """``v@i``, ``ran(E)@i``, ``Motion.psn@i``: the value at robot ``i``."""

    base: Expr
    robot: Expr


@dataclass(frozen=True, slots=True)
class Prime(Node):
    """``x'``: the value after a step."""

    base: Expr


@dataclass(frozen=True, slots=True)
class Binder(Node):
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


@dataclass(frozen=True, slots=True)
class Quantified(Node):
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


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """``target = value``; the target is a name, element, field or port."""

    target: Expr
    value: Expr


@dataclass(frozen=True, slots=True)
class Increment(Node):
    """``x++`` (``amount`` 1) or ``x--`` (``amount`` -1)."""

    target: Expr
    amount: int


@dataclass(frozen=True, slots=True)
class If(Node):
    """``if … elif … else``: each arm has a condition and a block; no ``else``, no ``otherwise``."""

    arms: tuple[tuple[Expr, Block], ...]
    otherwise: Block | None


@dataclass(frozen=True, slots=True)
class ForRange(Node):
    """``for i = low, high:`` from ``low`` up to and excluding ``high``."""

    variable: Ident
    low: Expr
    high: Expr
    body: Block


@dataclass(frozen=True, slots=True)
class ForEach(Node):
    """``for x in list:``, or ``for k, v in list:`` (index or key, and value)."""

    variables: tuple[Ident, ...]
    sequence: Expr
    body: Block


@dataclass(frozen=True, slots=True)
class Atomic(Node):
    """``atomic:``"""

    body: Block


@dataclass(frozen=True, slots=True)
class Break(Node):
    """``break``"""


@dataclass(frozen=True, slots=True)
class Return(Node):
    """``return e``"""

    value: Expr | None


@dataclass(frozen=True, slots=True)
class Stop(Node):
    """``stop`` (also ``stop()``)."""


@dataclass(frozen=True, slots=True)
class TryStop(Node):
    """``trystop()`` (also ``trystop``)."""


@dataclass(frozen=True, slots=True)
class Output(Node):
    """``stdout << a << b``: the stream, then what is written to it."""

    stream: Expr
    values: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class LocalDecl(Node):
    """A variable declared inside a function body: ``int best = 0``."""

    decl: VarDecl


@dataclass(frozen=True, slots=True)
class Pass(Node):
    """``pass``: an effect that does nothing."""


@dataclass(frozen=True, slots=True)
class CallStmt(Node):
    """A call for its effect: ``append(x, v)``, ``x.remove(v)``, ``assign(t, pid)``."""

    call: Call | MethodCall


Stmt = (
    Assign
    | Increment
    | If
    | ForRange
    | ForEach
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


@dataclass(frozen=True, slots=True)
class VarDecl(Node):
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


@dataclass(frozen=True, slots=True)
class VarSection(Node):
    """``local:``, ``allread:`` or ``allwrite:`` with its declarations."""

    kind: VarKind
    decls: tuple[VarDecl, ...]


@dataclass(frozen=True, slots=True)
class ParamDecl(Node):
    """``param int tasks = 4``: a constant of a run."""

    decl: VarDecl


@dataclass(frozen=True, slots=True)
class RecordDef(Node):
    """``def Task:`` or ``def adt Task:`` with its fields."""

    name: Ident
    fields: tuple[VarDecl, ...]


@dataclass(frozen=True, slots=True)
class EnumDef(Node):
    """``enum Mode: idle, pick, drop``"""

    name: Ident
    members: tuple[Ident, ...]


class External(Enum):
    """How the answers of an external function relate (decision record 0002)."""

    #: ``extern``: a mathematical function, equal answers for equal arguments.
    FUNCTION = "extern"
    #: ``extern fresh``: any value that the summary allows, a new one at each call.
    FRESH = "extern fresh"


@dataclass(frozen=True, slots=True)
class FunDef(Node):
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


@dataclass(frozen=True, slots=True)
class ContractDef(Node):
    """``contract NAME:`` with ``requires:`` (ports before) and ``ensures:`` (primed: after)."""

    name: Ident
    requires: tuple[Expr, ...]
    ensures: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Using(Node):
    """``using Motion:`` with port lists, contracts and at most one ``environment:`` block.

    A module used without a body (``using Motion``) has the ports of the library's module.
    ``environment`` is None where there is no such block.
    """

    module: Ident
    sensors: tuple[VarDecl, ...]
    actuators: tuple[VarDecl, ...]
    environment: Block | None
    contracts: tuple[ContractDef, ...]


@dataclass(frozen=True, slots=True)
class Init(Node):
    """``init:``"""

    body: Block


@dataclass(frozen=True, slots=True)
class Event(Node):
    """``name:`` or ``urgent name:`` with ``pre:`` (None: always) and ``eff:``."""

    name: Ident
    urgent: bool
    pre: Expr | None
    eff: Block


@dataclass(frozen=True, slots=True)
class Assume(Node):
    """``assume: e`` about the initial configuration; ``assume NAME: e`` names it."""

    name: Ident | None
    condition: Expr


@dataclass(frozen=True, slots=True)
class Invariant(Node):
    """``invariant NAME: e``; with ``at round`` it is asked of round ends only."""

    name: Ident | None
    at_round: bool
    condition: Expr


@dataclass(frozen=True, slots=True)
class Eventually(Node):
    """``eventually NAME: e``"""

    name: Ident | None
    goal: Expr


@dataclass(frozen=True, slots=True)
class LeadsTo(Node):
    """``eventually NAME: p leadsto q``, or ``assume NAME: p leadsto q`` if it is ``assumed``"""

    name: Ident | None
    trigger: Expr
    goal: Expr
    assumed: bool = False


@dataclass(frozen=True, slots=True)
class Agent(Node):
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


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment, for the printer. ``text`` keeps its ``//`` or ``#``."""

    line: int
    column: int
    text: str
    #: Whether the comment has its line for itself.
    own_line: bool


@dataclass(frozen=True, slots=True)
class Program(Node):
    """A file: its sections in order. Comments are kept beside the tree and not compared."""

    sections: tuple[Section, ...]
    comments: tuple[Comment, ...] = field(default=(), compare=False, repr=False)
    #: Where words stand that begin a block but have no node (``else``, ``pre``, ``sensors``, …),
    #: in the order of the text; for the printer, which puts comments beside them.
    heads: tuple[Ident, ...] = field(default=(), compare=False, repr=False)
    #: Names in what could not be read: they may have been declared or used there.
    lost: frozenset[str] = field(default=frozenset(), compare=False, repr=False)
