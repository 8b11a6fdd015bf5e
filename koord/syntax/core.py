"""The core program: the typed result of elaboration, and the input of the semantics.

No name is left to resolve and no type error is possible. Places are slots; every expression
carries its type; an ``int`` that is used as a ``float`` stands under ``Widen``. Constants of a run
(``param``) are already replaced by their values. The number of robots is not fixed yet: ``pid`` and
``numAgents`` remain.
"""

from __future__ import annotations

from enum import Enum
from fractions import Fraction

from msgspec import Struct

from koord.syntax.literals import ParamValue
from koord.syntax.source import Placed
from koord.syntax.types import BOOL, ArrayType, Type


class Node(Placed, frozen=True):
    """A node of the core program, with its place in the text."""


# --- places -------------------------------------------------------------------------------------


class Home(Enum):
    """The homes of variables."""

    LOCAL = "local"  #: of one robot
    PORT = "port"  #: sensor or actuator of one robot
    ALLREAD = "allread"  #: one entry per robot, written by its robot alone
    ALLWRITE = "allwrite"  #: one for all, written by anyone
    BOUND = "bound"  #: parameter, loop variable, quantified variable, local of a function


class Variable(Struct, frozen=True):
    """A variable: its home and slot there.

    The type is that of the whole variable: for ``ALLREAD`` it is ``ArrayType(T, Robots.ALL)``.
    Slots count from 0 per home; those of ``LOCAL`` and ``PORT`` count per agent kind, those of
    ``BOUND`` per body (event, function, property).
    """

    home: Home
    slot: int
    name: str
    type: Type

    @property
    def own_type(self) -> Type:
        """The type of what one robot has of it, and starts with: of ``ALLREAD``, its own entry."""
        if self.home is not Home.ALLREAD:
            return self.type
        assert isinstance(self.type, ArrayType)
        return self.type.element


class IndexStep(Node, frozen=True):
    """``[index]`` into an array, list or queue; outside of it is a fault."""

    index: Expr
    type: Type  #: of the element


class KeyStep(Node, frozen=True):
    """``[key]`` into a map. Reading a key that is not there is a fault; writing one adds it."""

    key: Expr
    type: Type  #: of the value


class FieldStep(Node, frozen=True):
    """``.name`` of a record; ``position`` is the field's place in its type."""

    position: int
    name: str
    type: Type  #: of the field


Step = IndexStep | KeyStep | FieldStep


class Place(Node, frozen=True):
    """A variable or a part of one.

    ``robot`` says whose local or port is meant (``v@i``; properties only); None means the robot
    that runs. ``primed`` means the value after a step (contracts only).
    """

    variable: Variable
    steps: tuple[Step, ...] = ()
    robot: Expr | None = None
    primed: bool = False

    @property
    def type(self) -> Type:
        return self.steps[-1].type if self.steps else self.variable.type

    def part(self, *steps: Step) -> Place:
        """The place of a part, by further steps; its span is this place's."""
        return Place(self.variable, (*self.steps, *steps), self.robot, self.primed, span=self.span)

    @property
    def is_below_key(self) -> bool:
        """True if the place is inside a map's entry, so that a write rewrites the entry.
        [LOCATION]
        """
        return any(isinstance(step, KeyStep) for step in self.steps[:-1])


# --- expressions --------------------------------------------------------------------------------


class UnaryOp(Enum):
    """Operators with one operand, total on their type."""

    NEG = "-"
    NOT = "not"
    ABS = "abs"
    WIDEN = "widen"  #: int to float


class BinaryOp(Enum):
    """Operators with two operands of one type. ``DIV`` and ``MOD`` fault on zero."""

    ADD = "+"
    SUB = "-"
    MUL = "*"
    DIV = "/"  #: of ints: rounds down; of floats: exact
    MOD = "%"  #: of ints, with the divisor's sign
    EQ = "=="
    NE = "!="
    LT = "<"
    LE = "<="
    AND = "and"  #: the right operand is evaluated only if the left is true
    OR = "or"  #: the right operand is evaluated only if the left is false
    IMPLIES = "implies"  #: the right operand is evaluated only if the left is true
    MIN = "min"
    MAX = "max"


class ListOp(Enum):
    """Functions of lists that need no index."""

    LENGTH = "length"  #: of an array, list, queue, map or string-free sequence
    CONTAINS = "contains"  #: (list, value) or (map, key)
    ANY = "any"
    ALL = "all"
    MIN = "min"  #: of a list of numbers; an empty one is a fault
    MAX = "max"
    KEYS = "keys"  #: of a map, in the order of its entries, as a list


class Const(Node, frozen=True):
    """A scalar constant: int, Fraction (float), bool, str, or the position of an enum member."""

    value: int | Fraction | bool | str
    type: Type


class Pid(Node, frozen=True):
    """``pid``, an int. Properties have no ``pid``: they are closed over all robots."""

    type: Type


class NumAgents(Node, frozen=True):
    """``numAgents``, an int."""

    type: Type


class Delta(Node, frozen=True):
    """``delta``, the length of a round in seconds, a float."""

    type: Type


class Read(Node, frozen=True):
    """The value at a place. [LOOKUP]"""

    place: Place

    @property
    def type(self) -> Type:
        return self.place.type


class Select(Node, frozen=True):
    """A part of a computed value: ``f(x)[i].loc``."""

    base: Expr
    step: Step

    @property
    def type(self) -> Type:
        return self.step.type


class Unary(Node, frozen=True):
    op: UnaryOp
    operand: Expr
    type: Type


class Binary(Node, frozen=True):
    """``EQ`` and ``NE`` compare any two values of one type; orders compare numbers."""

    op: BinaryOp
    left: Expr
    right: Expr
    type: Type


class Builtin(Node, frozen=True):
    op: ListOp
    arguments: tuple[Expr, ...]
    type: Type


class MakeList(Node, frozen=True):
    """A list (queue, array) of the given elements."""

    items: tuple[Expr, ...]
    type: Type


class MakeMap(Node, frozen=True):
    entries: tuple[tuple[Expr, Expr], ...]
    type: Type


class MakeRecord(Node, frozen=True):
    """A record, one expression per field in the type's order."""

    fields: tuple[Expr, ...]
    type: Type


class Call(Node, frozen=True):
    """A call of a function defined in Koord; ``site`` numbers the calls of the program."""

    function: str
    arguments: tuple[Expr, ...]
    type: Type
    site: int


class ExternalCall(Node, frozen=True):
    """A call of an external function; ``site`` numbers the calls of the program."""

    function: str
    arguments: tuple[Expr, ...]
    type: Type
    site: int


class Choose(Node, frozen=True):
    """``choose(low, high)``: a fresh value between the bounds, both included (floats or ints)."""

    low: Expr
    high: Expr
    type: Type
    site: int


class QuantifierKind(Enum):
    FORALL = "forall"
    EXISTS = "exists"


class RobotRange(Struct, frozen=True):
    """The range of all robots, or those of one agent kind (by position in ``Program.agents``)."""

    agent: int | None = None


class IntRange(Struct, frozen=True):
    """The range of integers ``[low, high)``."""

    low: Expr
    high: Expr


class Elements(Struct, frozen=True):
    """The range of a list's or array's elements; the bound variable is the element."""

    sequence: Expr


class AllValues(Struct, frozen=True):
    """The range of all values of a type; in summaries of external functions only."""

    type: Type


QuantifierDomain = RobotRange | IntRange | Elements | AllValues


class Quantified(Node, frozen=True):
    """A quantifier with one bound variable (``home`` BOUND); properties and summaries only."""

    quantifier: QuantifierKind
    variable: Variable
    domain: QuantifierDomain
    body: Expr
    type: Type = BOOL


class Ran(Node, frozen=True):
    """``ran(E)@i``: robot i ran that event in the round just ended.

    ``events`` are the positions of the events of that name, one per agent kind that has one.
    """

    events: tuple[tuple[int, int], ...]  #: (agent kind, position in its events)
    robot: Expr
    type: Type = BOOL


class Stopped(Node, frozen=True):
    """``stopped@i``"""

    robot: Expr
    type: Type = BOOL


Expr = (
    Const
    | Pid
    | NumAgents
    | Delta
    | Read
    | Select
    | Unary
    | Binary
    | Builtin
    | MakeList
    | MakeMap
    | MakeRecord
    | Call
    | ExternalCall
    | Choose
    | Quantified
    | Ran
    | Stopped
)


# --- statements ---------------------------------------------------------------------------------


class Assign(Node, frozen=True):
    """An assignment to a place. [LOCAL-ASSIGN], [SHARED-ASSIGN], [ALLREAD], [ACTUATE]"""

    place: Place
    value: Expr


class If(Node, frozen=True):
    condition: Expr
    then: Block
    otherwise: Block


class ForRange(Node, frozen=True):
    """A loop over ``[low, high)``, both evaluated once, before the loop.

    ``low`` and ``high`` are built from constants, ``pid``, ``numAgents`` and lengths only.
    """

    variable: Variable
    low: Expr
    high: Expr
    body: Block


class ForEach(Node, frozen=True):
    """A loop over the elements of a value taken before it. ``key`` is the index, or a map's key."""

    key: Variable | None
    value: Variable
    sequence: Expr
    body: Block


class Break(Node, frozen=True):
    """A ``break`` of the innermost loop."""


class Return(Node, frozen=True):
    """A return from the function, with a value."""

    value: Expr | None


class Atomic(Node, frozen=True):
    """An atomic block of a lock class. [ATOMIC]"""

    lock_class: int
    body: Block


class Stop(Node, frozen=True):
    """The statement ``stop``. [STOP]"""


class TryStop(Node, frozen=True):
    """The statement ``trystop()``. [STOP]"""


class Output(Node, frozen=True):
    """A write of values to a stream, in order. [OUTPUT]"""

    stream: str
    values: tuple[Expr, ...]


class Append(Node, frozen=True):
    """An append to a list or queue; it writes the whole list."""

    place: Place
    value: Expr


class Remove(Node, frozen=True):
    """A removal of the first element equal to the value, if there is one, or of a map's key."""

    place: Place
    value: Expr


class Pop(Node, frozen=True):
    """A pop: the first element of a queue, or the last of a list; of an empty one a fault.

    ``into`` receives it, if given.
    """

    place: Place
    into: Place | None


Stmt = (
    Assign
    | If
    | ForRange
    | ForEach
    | Break
    | Return
    | Atomic
    | Stop
    | TryStop
    | Output
    | Append
    | Remove
    | Pop
)

Block = tuple[Stmt, ...]


# --- declarations -------------------------------------------------------------------------------


class Start(Enum):
    """The state, before INIT, of a variable without an initial value."""

    UNSET = "unset"  #: nothing: reading it is a fault
    ARBITRARY = "arbitrary"  #: any value that the assumptions allow


class Declaration(Node, frozen=True):
    """A variable's declaration, with its start.

    ``initial`` of an allread variable is the value of the robot's own entry. Sensors without an
    initial value are ``ARBITRARY``; so is a variable without one that an ``assume`` reads.
    ``length`` is the length that an arbitrary list starts with, where an assumption fixes it.
    """

    variable: Variable
    initial: Expr | Start
    length: int | None = None


class Direction(Enum):
    SENSOR = "sensor"
    ACTUATOR = "actuator"


class Port(Node, frozen=True):
    """A port of a module: ``declaration.variable`` has home ``PORT``; its name is unqualified.

    Ports of the library may go by two names: ``spelling`` is the one that the program uses, for who
    reads of the port. Empty: that of the variable.
    """

    module: str
    direction: Direction
    declaration: Declaration
    spelling: str = ""

    @property
    def shown(self) -> str:
        """The name that the program uses, without the module."""
        return self.spelling or self.declaration.variable.name

    @property
    def label(self) -> str:
        """The name for people and files: ``Motion.position``."""
        return f"{self.module}.{self.shown}"


class Contract(Node, frozen=True):
    """A contract: if ``requires`` hold before the environment's turn, ``ensures`` hold after."""

    name: str
    requires: tuple[Expr, ...]
    ensures: tuple[Expr, ...]
    bound: int = 0


class Module(Node, frozen=True):
    """A module. ``environment`` reads ports before the turn and writes them after it.

    With an environment block the ports it does not write keep their values; without one every
    sensor takes any value that the contracts allow.
    """

    name: str
    ports: tuple[int, ...]  #: positions in the agent's ``ports``
    environment: Block | None
    environment_bound: int
    contracts: tuple[Contract, ...]


class Event(Node, frozen=True):
    """A guarded effect. ``bound`` is how many BOUND slots guard and effect need."""

    name: str
    urgent: bool
    guard: Expr
    effect: Block
    bound: int
    lock_classes: frozenset[int]


class Agent(Node, frozen=True):
    """A kind of robot. A program without ``agent`` blocks has a single kind, named ""."""

    name: str
    locals: tuple[Declaration, ...]
    ports: tuple[Port, ...]
    modules: tuple[Module, ...]
    init: Block
    init_bound: int
    events: tuple[Event, ...]


class Function(Node, frozen=True):
    """A function defined in Koord; parameters are the first BOUND slots. Never recursive.

    ``written`` is what the text calls it; empty: its name. Names are unique, and of the library
    several functions may be called alike.
    """

    name: str
    parameters: tuple[Variable, ...]
    result: Type | None
    body: Block
    bound: int
    written: str = ""

    @property
    def shown(self) -> str:
        """The name that the text uses."""
        return self.written or self.name


class ExternalKind(Enum):
    """The kinds of external functions: whether equal arguments give equal answers (record 0002)."""

    FUNCTION = "function"
    FRESH = "fresh"


class External(Node, frozen=True):
    """An external function, known by its summary only.

    ``requires`` and ``ensures`` see the parameters (the first BOUND slots) and, in ``ensures``, the
    answer (the slot behind them). Not meeting ``requires`` is a fault of the caller. One that
    ``constructs`` gives lists or records made of its arguments: of other arguments others.
    """

    name: str
    parameters: tuple[Variable, ...]
    result: Variable
    kind: ExternalKind
    requires: tuple[Expr, ...]
    ensures: tuple[Expr, ...]
    bound: int
    constructs: bool = False
    #: True: proofs take the summary for each answer, even where it asks other functions.
    by_answer: bool = False
    written: str = ""  #: as that of a :class:`Function`

    @property
    def shown(self) -> str:
        """The name that the text uses."""
        return self.written or self.name


class PropertyKind(Enum):
    INVARIANT = "invariant"  #: in every reachable configuration
    AT_ROUND = "at round"  #: in every configuration after ENV-TRANS, and after INIT
    EVENTUALLY = "eventually"
    LEADS_TO = "leads to"


class Each(Struct, frozen=True):
    """The robots that a statement is about, one by one, perhaps of one kind: the ``variable``."""

    variable: Variable
    agent: int | None = None


class Property(Node, frozen=True):
    """A property: a statement about configurations, closed except for ``each``.

    ``trigger`` is set for LEADS_TO only; ``each`` may be for that and for EVENTUALLY.
    """

    name: str
    kind: PropertyKind
    condition: Expr
    bound: int
    trigger: Expr | None = None
    each: Each | None = None


class Assumption(Node, frozen=True):
    """A closed statement about the configuration after INIT."""

    name: str
    condition: Expr
    bound: int


class LockClass(Struct, frozen=True):
    """A lock class: in each round at most one robot runs one of its atomic blocks. [ATOMIC]"""

    index: int
    variables: tuple[str, ...]  #: the allwrite variables its blocks write


#: So many robots one run has at most.
MOST_ROBOTS = 10_000

#: How long a round may be, in seconds: what clocks can tell, and what doubles and vehicles stand.
LEAST_DELTA_S, MOST_DELTA_S = Fraction(1, 10**9), Fraction(10**5)

#: Robots, and the length of a round in seconds, where neither a program nor anybody else says them.
USUAL_ROBOTS = 3
USUAL_DELTA_S = Fraction(1, 10)


def round_robin(robots: int, kinds: int) -> tuple[int, ...]:
    """The kinds of so many robots, to which they are dealt in order of declaration. [CONFIG]"""
    return tuple(at % kinds for at in range(robots))


class Instance(Struct, frozen=True):
    """The instance that a program's text states: ``kinds[i]`` is the position of robot i's kind.

    ``kinds`` is empty if the text says nothing of robots.

    It is no part of what a program means: whoever runs or verifies one chooses the instance.
    """

    kinds: tuple[int, ...] = ()
    delta_s: Fraction | None = None

    @property
    def used_delta_s(self) -> Fraction:
        """The length of a round in seconds, unless the user chooses another."""
        return USUAL_DELTA_S if self.delta_s is None else self.delta_s


class Parameter(Struct, frozen=True):
    """A param of a run: its value, and the one in the text; None if the text gives none."""

    name: str
    value: ParamValue
    written: ParamValue | None

    @property
    def is_set(self) -> bool:
        """True if the value differs from the one in the text."""
        return self.value != self.written


#: Where the tasks of a world are, in metres.
Places = tuple[tuple[Fraction, Fraction, Fraction], ...]


class Program(Node, frozen=True):
    """A core program.

    ``functions`` and ``externals`` are in order of dependence (a function calls earlier ones only).
    ``parameters`` are the constants of the run, with the values used. ``tasks`` are the places of
    the world's tasks, if a variable starts with them. ``expectations`` are statements of kind
    LEADS_TO that fair runs are supposed to satisfy. [FAIR-ASSUME]
    """

    name: str
    agents: tuple[Agent, ...]
    allread: tuple[Declaration, ...]
    allwrite: tuple[Declaration, ...]
    functions: tuple[Function, ...]
    externals: tuple[External, ...]
    lock_classes: tuple[LockClass, ...]
    assumptions: tuple[Assumption, ...]
    properties: tuple[Property, ...]
    parameters: tuple[Parameter, ...] = ()
    expectations: tuple[Property, ...] = ()
    instance: Instance = Instance()
    tasks: Places | None = None

    def function(self, name: str) -> Function:
        return next(f for f in self.functions if f.name == name)

    def external(self, name: str) -> External:
        return next(f for f in self.externals if f.name == name)


def slot_in(agent: Agent, variable: Variable) -> int | None:
    """The slot of a local or port in one kind of robot: kinds may number a name differently."""
    declarations = (
        agent.locals
        if variable.home is Home.LOCAL
        else tuple(port.declaration for port in agent.ports)
    )
    if variable.slot < len(declarations):
        here = declarations[variable.slot].variable
        if here.name == variable.name and here.type == variable.type:
            return variable.slot
    for declaration in declarations:
        if declaration.variable.name == variable.name:
            return declaration.variable.slot
    return None
