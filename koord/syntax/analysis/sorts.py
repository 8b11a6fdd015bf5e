"""Sorts of integers: unification finds which are robots and which are numbers. [SYMMETRY]

Every integer that a program stores or computes gets a *sort*. A sort is one of robots if ``pid``
flows into it, if it indexes an array over robots, or if it is compared with one that is; sorts flow
together through assignments, comparisons, arguments and indices (by unification, as types are
inferred). A sort is one of numbers if it is calculated with, ordered, or chosen. A sort that
indexes arrays of one fixed size may be one of *elements*, if nothing tells these apart [ELEMENTS].
"""

from __future__ import annotations

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import Home, slot_in
from koord.syntax.system import System
from koord.syntax.types import ArrayType, GrowingType, IntType, MapType, RecordType, Robots, Type


class Sort(Struct, eq=False):
    """A sort, or a link to the sort it has been unified with.

    ``number`` says why its values cannot be robots, and ``constants`` are those of the text that
    are among its values. ``apart`` says what tells the elements apart whose indices they may be,
    ``sizes`` has those of the arrays that they index (0: one element a robot), and ``cuts`` the
    numbers from which on they are told from those below.
    """

    is_robot: bool = False
    number: str = ""
    constants: set[int] = field(default_factory=set)
    apart: str = ""
    sizes: set[int] = field(default_factory=set)
    cuts: set[int] = field(default_factory=set)
    _same: Sort | None = None

    def root(self) -> Sort:
        """The representative of the sort after unification."""
        sort = self
        while sort._same is not None:
            sort = sort._same
        return sort

    def unify(self, other: Sort) -> None:
        """Unify two sorts."""
        a, b = self.root(), other.root()
        if a is b:
            return
        b._same = a
        a.is_robot |= b.is_robot
        a.number = a.number or b.number
        a.constants |= b.constants
        a.apart = a.apart or b.apart
        a.sizes |= b.sizes
        a.cuts |= b.cuts

    def be_robot(self) -> None:
        self.root().is_robot = True

    def be_number(self, reason: str, *, tells_apart: bool = True) -> None:
        """Note why its values are no robots, and, mostly, that elements are told apart by it."""
        root = self.root()
        root.number = root.number or reason
        if tells_apart:
            self.tell_apart(reason)

    def tell_apart(self, reason: str) -> None:
        root = self.root()
        root.apart = root.apart or reason

    def cut(self, *numbers: int) -> None:
        """Note that its values are told from those below some numbers."""
        self.root().cuts.update(numbers)


class Scalar(Struct, frozen=True, eq=False):
    """The sort of an integer; None for scalars that are no integers."""

    sort: Sort | None


class Fields(Struct, frozen=True, eq=False):
    """The sorts in a record."""

    parts: tuple[Shape, ...]


class Items(Struct, frozen=True, eq=False):
    """The sorts in a list or array: of its indices, and of its elements.

    ``is_over_robots`` says whether it has one element for each robot, always.
    """

    index: Sort
    element: Shape
    is_over_robots: bool


class Entries(Struct, frozen=True, eq=False):
    """The sorts in a map."""

    key: Shape
    value: Shape


Shape = Scalar | Fields | Items | Entries


def shape(type_: Type) -> Shape:
    """Fresh sorts for a type."""
    match type_:
        case IntType():
            return Scalar(Sort())
        case RecordType(fields=fields):
            return Fields(tuple(shape(part) for _, part in fields))
        case ArrayType(element=element, size=size):
            sizes = {size if isinstance(size, int) else 0}
            return Items(Sort(sizes=sizes), shape(element), size is Robots.ALL)
        case GrowingType(element=element):
            changing = Sort(apart="an index into a list of any length")
            return Items(changing, shape(element), False)
        case MapType(key=key, value=value):
            keys = shape(key)
            be_apart(keys, "a key of a map")
            return Entries(keys, shape(value))
        case _:
            return Scalar(None)


def unify(left: Shape, right: Shape) -> None:
    """Unify two shapes of one type. An array may meet a list."""
    match left, right:
        case Scalar(sort=a), Scalar(sort=b):
            if a is not None and b is not None:
                a.unify(b)
        case Fields(parts=first), Fields(parts=second):
            for one, other in zip(first, second, strict=True):
                unify(one, other)
        case Items(), Items():
            left.index.unify(right.index)
            unify(left.element, right.element)
        case Entries(), Entries():
            unify(left.key, right.key)
            unify(left.value, right.value)
        case _:
            raise AssertionError((left, right))


class BodyShapes(Struct):
    """The context of an expression in sort inference: its body, and its bound variables' shapes.

    ``strict`` holds where a statement is false if the expression is: there it does not matter
    whether it is false or faults.
    """

    sure: Sure
    bound: dict[core.Variable, Shape] = field(default_factory=dict)
    result: Shape | None = None
    strict: bool = False

    @property
    def kind(self) -> int | None:
        return self.sure.kind


class Range(Struct, frozen=True):
    """A range over all robots, if its variable is one; ``is_free``: its order does not matter."""

    variable: Sort
    over: Sort | None  #: the index of the list over whose indices it goes
    is_free: bool


class Span(Struct, frozen=True):
    """A range from 0 to a constant: over all elements, if its variable is one of so many."""

    variable: Sort
    size: int
    is_free: bool


class SortTable:
    """The sorts of one system inferred so far."""

    def __init__(self, system: System) -> None:
        program = system.program
        self.system = system
        self.ranges: list[Range] = []
        self.spans: list[Span] = []
        self._sorts: list[Sort] = []
        self.locals = [[self.held(x.variable.type) for x in a.locals] for a in program.agents]
        self.ports = [
            [self.held(p.declaration.variable.type) for p in a.ports] for a in program.agents
        ]
        self.allread = [self._over_robots(x.variable.type) for x in program.allread]
        self.allwrite = [self.held(x.variable.type) for x in program.allwrite]
        self.externals: dict[str, tuple[list[Shape], Shape]] = {}

    # --- verdicts -------------------------------------------------------------------------------

    def reason(self) -> str:
        """The reason why robots may not change places; empty if they may."""
        for sort in self._sorts:
            root = sort.root()
            if root.is_robot and root.number:
                return f"a robot's number is {root.number}"
        for each in self.ranges:
            if each.variable.root().is_robot:
                if each.over is not None and not each.over.root().is_robot:
                    return "a loop over a list's indices runs over robots"
                if not each.is_free:
                    return "a loop over robots may depend on their order"
        return ""

    def fixed(self) -> frozenset[int]:
        """The robots that the text names by number."""
        roots = [sort.root() for sort in self._sorts]
        named = {c for root in roots if root.is_robot for c in root.constants}
        return frozenset(named & set(range(self.system.robots)))

    def elements(self) -> list[tuple[Sort, int, tuple[int, ...]]]:
        """The sorts of elements that nobody tells apart, how many there are, and which these are.

        Those that the text names by number are told apart from the others.
        """
        for each in self.ranges:
            over = each.over.root() if each.over is not None else each.variable.root()
            if not each.is_free or over is not each.variable.root():
                reason = "a loop over elements may depend on their order"
                each.variable.tell_apart(reason)
        for span in self.spans:
            if not span.is_free:
                span.variable.tell_apart("a loop over elements may depend on their order")
            span.variable.root().sizes.add(span.size)
        found = []
        for root in {id(sort.root()): sort.root() for sort in self._sorts}.values():
            if root.is_robot or root.apart or len(root.sizes) != 1:
                continue
            (size,) = root.sizes
            if all(cut <= 0 or cut >= size for cut in root.cuts):
                others = tuple(k for k in range(size) if k not in root.constants)
                if len(others) > 1:
                    found.append((root, size, others))
        return found

    # --- new shapes -----------------------------------------------------------------------------

    def fresh(self, type_: Type) -> Shape:
        """A shape for values of a type, with fresh sorts."""
        return self._noted(shape(type_))

    def _noted(self, of: Shape) -> Shape:
        match of:
            case Scalar(sort=sort):
                if sort is not None:
                    self._sorts.append(sort)
            case Fields(parts=parts):
                for part in parts:
                    self._noted(part)
            case Items(index=index, element=element):
                self._sorts.append(index)
                self._noted(element)
            case Entries(key=key, value=value):
                self._noted(key)
                self._noted(value)
        return of

    def held(self, type_: Type) -> Shape:
        """A shape for the contents of a variable: its lists have any length."""
        of = self.fresh(type_)
        _number_lists(of)
        return of

    def _over_robots(self, type_: Type) -> Shape:
        of = self.held(type_)
        assert isinstance(of, Items)
        of.index.be_robot()
        return of

    def integer(
        self, *, number: str = "", constant: int | None = None, tells_apart: bool = True
    ) -> Scalar:
        """The shape of an integer: a number, for the reason given, or a constant of the text."""
        sort = Sort(number=number, apart=number if tells_apart else "")
        if constant is not None:
            sort.constants.add(constant)
        self._sorts.append(sort)
        return Scalar(sort)

    def robot(self) -> Scalar:
        """The shape of an integer that is a robot."""
        made = self.integer()
        assert made.sort is not None
        made.sort.be_robot()
        return made

    # --- shapes of variables --------------------------------------------------------------------

    def variable(self, variable: core.Variable, body: BodyShapes) -> Shape:
        """The shape of a variable that a body names."""
        match variable.home:
            case Home.BOUND:
                return self.bound(variable, body)
            case Home.ALLREAD:
                return self.allread[variable.slot]
            case Home.ALLWRITE:
                return self.allwrite[variable.slot]
            case Home.LOCAL | Home.PORT:
                shapes = self.locals if variable.home is Home.LOCAL else self.ports
                if body.kind is not None:
                    return shapes[body.kind][variable.slot]
                return self._of_any_kind(variable, shapes)

    def _of_any_kind(self, variable: core.Variable, shapes: list[list[Shape]]) -> Shape:
        """The variable of that name in every kind of robot that has one."""
        found = []
        for agent, of_kind in zip(self.system.program.agents, shapes, strict=True):
            slot = slot_in(agent, variable)
            if slot is not None:
                found.append(of_kind[slot])
        for other in found[1:]:
            unify(found[0], other)
        return found[0] if found else self.fresh(variable.type)

    def bound(self, variable: core.Variable, body: BodyShapes) -> Shape:
        """The shape of a bound variable of a body."""
        if variable not in body.bound:
            body.bound[variable] = self.fresh(variable.type)
        return body.bound[variable]


def be_number(of: Shape, reason: str) -> None:
    """Mark an integer of that shape as a number, for a reason; ignore other shapes."""
    if isinstance(of, Scalar) and of.sort is not None:
        of.sort.be_number(reason)


def be_apart(of: Shape, reason: str) -> None:
    """Note that elements are told apart whose indices are anywhere in a value of that shape."""
    match of:
        case Scalar(sort=sort):
            if sort is not None:
                sort.tell_apart(reason)
        case Fields(parts=parts):
            for part in parts:
                be_apart(part, reason)
        case Items(index=index, element=element):
            index.tell_apart(reason)
            be_apart(element, reason)
        case Entries(key=key, value=value):
            be_apart(key, reason)
            be_apart(value, reason)


def number_robots(of: Shape) -> None:
    """Mark all integers in a value of that shape as numbers, not robots."""
    match of:
        case Scalar():
            be_number(of, "any integer")
        case Fields(parts=parts):
            for part in parts:
                number_robots(part)
        case Items(element=element):
            number_robots(element)
        case Entries(key=key, value=value):
            number_robots(key)
            number_robots(value)


def _number_lists(of: Shape) -> None:
    """Mark the indices of lists as numbers: lists of any length are not indexed by robots."""
    match of:
        case Scalar():
            pass
        case Fields(parts=parts):
            for part in parts:
                _number_lists(part)
        case Items(index=index, element=element, is_over_robots=over):
            if not over:
                # What has a fixed size may still have elements that nobody tells apart.
                index.be_number("an index into a list of any length", tells_apart=False)
            _number_lists(element)
        case Entries(key=key, value=value):
            _number_lists(key)
            _number_lists(value)
