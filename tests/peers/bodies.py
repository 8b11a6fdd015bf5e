"""Expressions as C. Each function says which rule it follows; nothing here looks at an engine.

A body runs with a ``struct Context *cx``. A fault, a missing answer and an answer that is not legal
leave the body by ``longjmp`` (``prelude.h``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count as counting

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.types import (
    INT,
    ArrayType,
    BoolType,
    EnumType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Type,
)
from tests.peers.shapes import ROOM, NotCoveredError, Shapes

_SEQUENCE = ArrayType | ListType | QueueType

_PLAIN = {
    BinaryOp.ADD: "add",
    BinaryOp.SUB: "subtract",
    BinaryOp.MUL: "multiply",
    BinaryOp.DIV: "divide",
    BinaryOp.MOD: "modulo",
    BinaryOp.MIN: "least",
    BinaryOp.MAX: "greatest",
}


@dataclass
class Body:
    """The making of one C function: the program, and the bound variables met so far."""

    program: core.Program
    shapes: Shapes
    texts: dict[str, int]
    names: counting[int]
    kind: int | None = None  #: of the robot that runs; None in properties
    result: Type | None = None  #: of a function
    bound: dict[str, str] = field(default_factory=dict)  #: C name of a bound variable, its C type

    def fresh(self) -> str:
        return f"t{next(self.names)}"

    def declarations(self) -> str:
        """What stands first in the C function. All atoms start unset."""
        return " ".join(
            f"{type_} {name}; memset(&{name}, 0, sizeof {name});"
            for name, type_ in self.bound.items()
        )

    # --- places ---------------------------------------------------------------------------------

    def home(self, place: core.Place) -> str:
        """A pointer to the storage of the place's variable. [LOOKUP] [PROP-READ]"""
        variable = place.variable
        match variable.home:
            case Home.BOUND:
                return self.bind(variable)
            case Home.ALLREAD:
                return f"(&cx->copy->r{variable.slot})"
            case Home.ALLWRITE:
                return f"(&cx->copy->w{variable.slot})"
            case Home.LOCAL | Home.PORT:
                letter = "l" if variable.home is Home.LOCAL else "p"
                if place.robot is not None:
                    return self._of_robot(place.robot, variable, letter)
                robot = "cx->out" if place.primed else "cx->me"
                return f"(&{robot}->a{self.kind}{letter}{variable.slot})"

    def bind(self, variable: core.Variable) -> str:
        """A pointer to a bound variable."""
        name = f"b{variable.slot}_{self.shapes.number(variable.type)}"
        self.bound[name] = self.shapes.storage(variable.type)
        return f"(&{name})"

    def _of_robot(self, robot: core.Expr, variable: core.Variable, letter: str) -> str:
        """``v@i``: a fault if there is no such robot, or none with that variable."""
        index, found = self.fresh(), self.fresh()
        cases = []
        for kind, agent in enumerate(self.program.agents):
            entries = agent.locals
            if variable.home is Home.PORT:
                entries = tuple(port.declaration for port in agent.ports)
            cases += [
                f"if (KIND[{index}] == {kind}) "
                f"{found} = &cx->state->robots[{index}].a{kind}{letter}{entry.variable.slot};"
                for entry in entries
                if entry.variable.name == variable.name
            ]
        type_ = self.shapes.storage(variable.type)
        return (
            f"({{ int {index} = {self.expr(robot)}; const {type_} *{found} = 0; "
            f"if ({index} >= 0 && {index} < ROBOTS) {{ {' '.join(cases)} }} "
            f"if (!{found}) LEAVE(FAULT); {found}; }})"
        )

    def read(self, place: core.Place) -> str:
        """[LOOKUP]: into the tree as far as it goes, then read, then into the value."""
        at, type_ = self.home(place), place.variable.type
        steps = list(place.steps)
        while steps and isinstance(type_, RecordType | ArrayType):
            match steps.pop(0):
                case core.FieldStep(position=position, type=after):
                    at = f"(&{at}->f{position})"
                case core.IndexStep(index=index, type=after):
                    assert isinstance(type_, ArrayType)
                    within = f"within({self.expr(index)}, {self.shapes.size(type_)})"
                    at = f"(&{at}->items[{within}])"
                case core.KeyStep():
                    raise NotCoveredError("key into a tree")
            type_ = after
        value = f"read{self.shapes.number(type_)}({at})"
        for step in steps:
            value = self.select(value, type_, step)
            type_ = step.type
        return value

    def select(self, value: str, type_: Type, step: core.Step) -> str:
        """[E-SELECT]"""
        whole, at = self.fresh(), self.fresh()
        begun = f"{self.shapes.value(type_)} {whole} = {value}"
        match step:
            case core.FieldStep(position=position):
                return f"({{ {begun}; {whole}.f{position}; }})"
            case core.IndexStep(index=index):
                within = f"within({self.expr(index)}, {self.shapes.count(type_, whole)})"
                return f"({{ {begun}; int {at} = {within}; {whole}.items[{at}]; }})"
            case core.KeyStep(key=key):
                assert isinstance(type_, MapType)
                found = f"find{self.shapes.number(type_)}(&{whole}, {self.as_(key, type_.key)})"
                return (
                    f"({{ {begun}; int {at} = {found}; if ({at} < 0) LEAVE(FAULT); "
                    f"{whole}.items[{at}]; }})"
                )

    # --- values ---------------------------------------------------------------------------------

    def as_(self, e: core.Expr, wanted: Type) -> str:
        """An expression where a value of a type is wanted: an array is a list there."""
        return self.converted(self.expr(e), e.type, wanted)

    def converted(self, value: str, given: Type, wanted: Type) -> str:
        if given == wanted or self.shapes.number(given) == self.shapes.number(wanted) == 0:
            return value
        if not isinstance(given, _SEQUENCE) or not isinstance(wanted, ListType | QueueType):
            raise NotCoveredError(f"{type(given).__name__} as {type(wanted).__name__}")
        a, b, i = self.fresh(), self.fresh(), self.fresh()
        to = self.shapes.value(wanted)
        element = self.converted(f"{a}.items[{i}]", given.element, wanted.element)
        size = self.shapes.count(given, a)
        return (
            f"({{ {self.shapes.value(given)} {a} = {value}; {to} {b}; memset(&{b}, 0, sizeof {b}); "
            f"int {i}; if ({size} > {ROOM}) TOO_LARGE(); {b}.n = {size}; "
            f"for ({i} = 0; {i} < {size}; {i}++) {b}.items[{i}] = {element}; {b}; }})"
        )

    def expr(self, e: core.Expr) -> str:
        """The value of an expression, of the C type that stands for the expression's type."""
        match e:
            case core.Const(value=bool() | int() as value):
                return f"({int(value)})"
            case core.Const(value=str() as value):
                return str(self.texts.setdefault(value, len(self.texts)))
            case core.Const():
                raise NotCoveredError("FloatType")
            case core.Pid():
                return "cx->pid"
            case core.NumAgents():
                return "ROBOTS"
            case core.Read(place=place):
                return self.read(place)
            case core.Select(base=base, step=step):
                return self.select(self.expr(base), base.type, step)
            case core.Unary(op=op, operand=operand):
                return self._unary(op, self.expr(operand))
            case core.Binary():
                return self._binary(e)
            case core.Builtin():
                return self._builtin(e)
            case core.MakeList() | core.MakeMap() | core.MakeRecord():
                return self._make(e)
            case core.Call(function=name, arguments=arguments):
                parameters = self.program.function(name).parameters
                return f"f_{name}({self._arguments(parameters, arguments)})"
            case core.ExternalCall(function=name, arguments=arguments):
                parameters = self.program.external(name).parameters
                return f"g_{name}({self._arguments(parameters, arguments)})"
            case core.Choose(low=low, high=high):
                if e.type != INT:
                    raise NotCoveredError("choose of a float")
                return f"choice({self.expr(low)}, {self.expr(high)})"
            case core.Quantified():
                return self._quantified(e)
            case core.Ran(events=events, robot=robot):
                at = self.fresh()
                did = " || ".join(
                    f"(KIND[{at}] == {kind} && cx->state->robots[{at}].ran == {position + 1})"
                    for kind, position in events
                )
                inside = f"{at} >= 0 && {at} < ROBOTS"
                return f"({{ int {at} = {self.expr(robot)}; {inside} && ({did or 0}); }})"
            case core.Stopped(robot=robot):
                at = self.fresh()
                inside = f"{at} >= 0 && {at} < ROBOTS"
                stopped = f"cx->state->robots[{at}].status == STOPPED"
                return f"({{ int {at} = {self.expr(robot)}; {inside} && {stopped}; }})"
            case _:
                raise NotCoveredError(type(e).__name__)

    def _arguments(
        self, parameters: tuple[core.Variable, ...], arguments: tuple[core.Expr, ...]
    ) -> str:
        pairs = zip(parameters, arguments, strict=True)
        return ", ".join(["cx", *(self.as_(e, p.type) for p, e in pairs)])

    def _unary(self, op: UnaryOp, operand: str) -> str:
        match op:
            case UnaryOp.NEG:
                return f"subtract(0, {operand})"
            case UnaryOp.NOT:
                return f"(!{operand})"
            case UnaryOp.ABS:
                return f"abs({operand})"
            case UnaryOp.WIDEN:
                raise NotCoveredError("FloatType")

    def _binary(self, e: core.Binary) -> str:
        """[E-ARITH] [E-EQUAL] [E-SHORT]: operands from left to right."""
        left, right = self.expr(e.left), self.expr(e.right)
        match e.op:
            case BinaryOp.AND:
                return f"({left} && {right})"
            case BinaryOp.OR:
                return f"({left} || {right})"
            case BinaryOp.IMPLIES:
                return f"(!{left} || {right})"
            case BinaryOp.EQ | BinaryOp.NE:
                same = self.equal(left, e.left.type, right, e.right.type)
                return same if e.op is BinaryOp.EQ else f"(!{same})"
            case BinaryOp.LT | BinaryOp.LE:
                self._number(e.left.type)
                return f"({left} {e.op.value} {right})"
            case _:
                self._number(e.left.type)
                return f"{_PLAIN[e.op]}({left}, {right})"

    def _number(self, type_: Type) -> None:
        if type_ != INT:
            raise NotCoveredError(type(type_).__name__)

    def equal(self, left: str, left_type: Type, right: str, right_type: Type) -> str:
        wanted = right_type if isinstance(left_type, ArrayType) else left_type
        a = self.converted(left, left_type, wanted)
        b = self.converted(right, right_type, wanted)
        return f"eq{self.shapes.number(wanted)}({a}, {b})"

    def _builtin(self, e: core.Builtin) -> str:
        """[E-LIST]"""
        first = e.arguments[0]
        if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
            return str(self.shapes.size(first.type))
        whole, i, result = self.fresh(), self.fresh(), self.fresh()
        size = self.shapes.count(first.type, whole)
        begun = f"{self.shapes.value(first.type)} {whole} = {self.expr(first)}"
        loop = f"int {i}; for ({i} = 0; {i} < {size}; {i}++)"
        item = f"{whole}.items[{i}]"
        match e.op:
            case ListOp.LENGTH:
                return f"({{ {begun}; {size}; }})"
            case ListOp.CONTAINS if isinstance(first.type, MapType):
                key = self.as_(e.arguments[1], first.type.key)
                return (
                    f"({{ {begun}; find{self.shapes.number(first.type)}(&{whole}, {key}) >= 0; }})"
                )
            case ListOp.CONTAINS:
                assert isinstance(first.type, _SEQUENCE)
                other, sought = e.arguments[1], self.fresh()
                same = self.equal(item, first.type.element, sought, other.type)
                return (
                    f"({{ {begun}; {self.shapes.value(other.type)} {sought} = {self.expr(other)}; "
                    f"int {result} = 0; {loop} if ({same}) {result} = 1; {result}; }})"
                )
            case ListOp.ANY:
                return f"({{ {begun}; int {result} = 0; {loop} {result} |= {item}; {result}; }})"
            case ListOp.ALL:
                return f"({{ {begun}; int {result} = 1; {loop} {result} &= {item}; {result}; }})"
            case ListOp.KEYS:
                raise NotCoveredError("keys")
            case ListOp.MIN | ListOp.MAX:
                self._number(e.type)
                fold = "least" if e.op is ListOp.MIN else "greatest"
                return (
                    f"({{ {begun}; if ({size} == 0) LEAVE(FAULT); int {result} = {whole}.items[0]; "
                    f"{loop} {result} = {fold}({result}, {item}); {result}; }})"
                )

    def _make(self, e: core.MakeList | core.MakeMap | core.MakeRecord) -> str:
        """[E-CONST] [E-MAP]"""
        made = self.fresh()
        parts = [f"{self.shapes.value(e.type)} {made}; memset(&{made}, 0, sizeof {made});"]
        match e:
            case core.MakeRecord(fields=fields, type=RecordType(fields=types)):
                for n, (part, (_, type_)) in enumerate(zip(fields, types, strict=True)):
                    parts.append(f"{made}.f{n} = {self.as_(part, type_)};")
            case core.MakeList(items=items, type=ArrayType() | ListType() | QueueType() as type_):
                if isinstance(type_, ArrayType):
                    if len(items) != self.shapes.size(type_):
                        raise NotCoveredError("a literal shorter than its array")
                elif len(items) > ROOM:
                    raise NotCoveredError("a long literal")
                else:
                    parts.append(f"{made}.n = {len(items)};")
                for n, item in enumerate(items):
                    parts.append(f"{made}.items[{n}] = {self.as_(item, type_.element)};")
            case core.MakeMap(entries=entries, type=MapType() as type_):
                for key, value in entries:
                    k, v = self.fresh(), self.fresh()
                    parts.append(
                        f"{self.shapes.value(type_.key)} {k} = {self.as_(key, type_.key)}; "
                        f"{self.shapes.value(type_.value)} {v} = {self.as_(value, type_.value)}; "
                        f"{made}.items[place{self.shapes.number(type_)}(&{made}, {k})] = {v};"
                    )
            case _:
                raise NotCoveredError(f"{type(e).__name__} of {type(e.type).__name__}")
        return f"({{ {' '.join(parts)} {made}; }})"

    def _quantified(self, e: core.Quantified) -> str:
        """[E-QUANT]: it stops as soon as the result is decided."""
        variable = self.bind(e.variable)
        write = f"write{self.shapes.number(e.variable.type)}"
        i, result = self.fresh(), self.fresh()
        wanted = e.quantifier is core.QuantifierKind.EXISTS
        begun, loop, item = "", f"for ({i} = 0; {i} < ROBOTS; {i}++)", i
        match e.domain:
            case core.RobotRange(agent=None):
                pass
            case core.RobotRange(agent=agent):
                loop += f" if (KIND[{i}] == {agent})"
            case core.IntRange(low=low, high=high):
                a, b = self.fresh(), self.fresh()
                begun = f"int {a} = {self.expr(low)}; int {b} = {self.expr(high)};"
                loop = f"for ({i} = {a}; {i} < {b}; {i}++)"
            case core.Elements(sequence=sequence):
                whole = self.fresh()
                assert isinstance(sequence.type, _SEQUENCE)
                begun = f"{self.shapes.value(sequence.type)} {whole} = {self.expr(sequence)};"
                loop = f"for ({i} = 0; {i} < {self.shapes.count(sequence.type, whole)}; {i}++)"
                item = self.converted(f"{whole}.items[{i}]", sequence.type.element, e.variable.type)
            case _:
                raise NotCoveredError(type(e.domain).__name__)
        body = self.expr(e.body)
        decided = body if wanted else f"!{body}"
        return (
            f"({{ {begun} int {result} = {int(not wanted)}; int {i}; {loop} "
            f"{{ {write}({variable}, {item}); "
            f"if ({decided}) {{ {result} = {int(wanted)}; break; }} }} "
            f"{result}; }})"
        )

    # --- what is left open ----------------------------------------------------------------------

    def arbitrary(self, type_: Type, length: int | None = None) -> str:
        """Any value of a type; of integers a few, of which the outermost must not be legal."""
        made = self.fresh()
        match type_:
            case BoolType():
                return "pick(2)"
            case EnumType(members=members):
                return f"pick({len(members)})"
            case _ if type_ == INT:
                return "any_int()"
            case RecordType(fields=fields):
                parts = [(f"f{n}", t) for n, (_, t) in enumerate(fields)]
            case ArrayType(element=element):
                parts = [(f"items[{n}]", element) for n in range(self.shapes.size(type_))]
            case ListType(element=element) if length is not None:
                parts = [(f"items[{n}]", element) for n in range(length)]
            case _:
                raise NotCoveredError(f"any {type(type_).__name__}")
        size = f"{made}.n = {length};" if isinstance(type_, ListType) else ""
        filled = " ".join(f"{made}.{part} = {self.arbitrary(t)};" for part, t in parts)
        begun = f"{self.shapes.value(type_)} {made}; memset(&{made}, 0, sizeof {made});"
        return f"({{ {begun} {size} {filled} {made}; }})"
