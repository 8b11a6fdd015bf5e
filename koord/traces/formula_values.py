"""Values of the parts of a formula, by the reference evaluator.

Every value that is told is what :func:`koord.semantics.expressions.evaluate` gives for the part
itself, so that nothing of the rules is said again; what stands here is only which parts there are,
and which of them decides. [PROP-INVARIANT] [E-QUANT] [E-SHORT]
"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.domain import Constant, NumberTooLongError
from koord.semantics.machine import Machine
from koord.semantics.quantifiers import instances
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import held
from koord.semantics.values import Value
from koord.syntax import core
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.printing.quoting import Quoting
from koord.syntax.types import INT
from koord.traces.rendering import show_value
from koord.traces.story_form import FormulaNode

#: So many parts of a formula are told; more are counted.
MOST_NODES = 400

#: Of a quantifier so many instances that do not decide are told.
_MOST_SPARE = 24

_TRUE, _FALSE = "true", "false"


class FormulaReader(Struct):
    """A reader of formulas on one machine. ``left`` is how many parts may still be told."""

    machine: Machine[Constant]
    quoting: Quoting
    left: int = MOST_NODES

    def root(self, e: core.Expr) -> FormulaNode:
        """Evaluate a formula and its parts; the root decides."""
        return replace(self._node(e, ""), decides=True)

    def together(self, text: str, op: BinaryOp, parts: Iterable[FormulaNode]) -> FormulaNode:
        """A conjunction or an implication of parts that the program states apart."""
        found = list(parts)
        values = [part.value for part in found]
        if op is BinaryOp.IMPLIES:
            left, right = found
            value = _FALSE if (left.value, right.value) == (_TRUE, _FALSE) else _TRUE
        else:
            value = _TRUE if all(value == _TRUE for value in values) else _FALSE
        return FormulaNode(text, value, "", True, "", _deciding(op, value, found), 0)

    # --- one part -------------------------------------------------------------------------------

    def _node(self, e: core.Expr, binding: str) -> FormulaNode:
        self.left -= 1
        value, note = self._value(e)
        text = self.quoting.text(e)
        node = FormulaNode(text, value, binding, False, note, [], 0)
        if self.left <= 0:
            return replace(node, left_out=1 if _operands(e) else 0)
        if isinstance(e, core.Quantified):
            return self._quantified(e, node)
        if isinstance(e, core.Binary) and e.op in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES):
            return replace(node, parts=_deciding(e.op, value, self._in_turn(e)))
        parts = [self._node(part, "") for part in _operands(e)]
        return replace(node, parts=[replace(part, decides=True) for part in parts])

    def _value(self, e: core.Expr) -> tuple[str | None, str]:
        """The value of a part, as a text, or why there is none."""
        found = self._evaluated(e)
        if isinstance(found, str):
            return None, found
        return show_value(found[0], e.type), ""

    def _evaluated(self, e: core.Expr) -> tuple[Value[Constant]] | str:
        """The value of a part, or why there is none."""
        m = self.machine
        faults, faulted, m.faults = m.faults, m.faulted, []
        try:
            value = m.value(e)
            if m.faults:
                return m.faults[0][1].kind.value
            return (value,)
        except IllegalStepError:
            return "nobody answered"
        except NumberTooLongError:
            return "a number too long to compute with"
        finally:
            m.faults, m.faulted = faults, faulted

    def _in_turn(self, e: core.Binary) -> list[FormulaNode]:
        """The operands of a connective, as far as the rules look at them. [E-SHORT]"""
        operands = _flat(e, e.op)
        stop = _TRUE if e.op is BinaryOp.OR else _FALSE
        found: list[FormulaNode] = []
        for operand in operands:
            if found and (found[-1].value in (stop, None)):
                text = self.quoting.text(operand)
                found.append(FormulaNode(text, None, "", False, "not looked at", [], 0))
            else:
                found.append(self._node(operand, ""))
        return found

    # --- quantifiers ----------------------------------------------------------------------------

    def _quantified(self, e: core.Quantified, node: FormulaNode) -> FormulaNode:
        """The instances of a quantifier; what decides it is told in any case. [E-QUANT]"""
        if isinstance(e.domain, core.AllValues) or node.note:
            return node
        m = self.machine
        name, slot = e.variable.name, e.variable.slot
        universal = e.quantifier is QuantifierKind.FORALL
        decided = _FALSE if universal else _TRUE
        found: list[FormulaNode] = []
        spare = left_out = 0
        before = m.memory.bound[slot]
        for label, here, value in instances(m, e):
            if here is not True:
                continue
            m.memory.bound[slot] = held(m.d, value)
            m.trail.append(label)
            type_ = INT if isinstance(e.domain, core.RobotRange) else e.variable.type
            binding = f"{name} = {show_value(value, type_)}"
            shown, note = self._value(e.body)
            decides = shown == decided or bool(note)
            if decides or (spare < _MOST_SPARE and self.left > 0):
                if decides:
                    self.left = max(self.left, 60)  # the reader came for this one
                else:
                    spare += 1
                part = self._node(e.body, binding)
                found += self._joined(part, e, decides=decides)
            else:
                left_out += 1
            m.trail.pop()
            if decides:
                break
        m.memory.bound[slot] = before
        if not any(part.decides for part in found):
            found = [replace(part, decides=True) for part in found]
        return replace(node, parts=found, left_out=left_out)

    def _joined(self, part: FormulaNode, e: core.Quantified, *, decides: bool) -> list[FormulaNode]:
        """An instance; of quantifiers that stand right below each other, those of the inner one."""
        body = e.body
        inner = isinstance(body, core.Quantified) and body.quantifier is e.quantifier
        if not inner or not part.parts or part.left_out:
            return [replace(part, decides=decides)]
        return [
            replace(
                below,
                binding=f"{part.binding}, {below.binding}",
                decides=decides and below.decides,
            )
            for below in part.parts
        ]


def _deciding(op: BinaryOp, value: str | None, parts: list[FormulaNode]) -> list[FormulaNode]:
    """The operands of a connective, marked by whether they decide it."""
    if op is BinaryOp.IMPLIES:
        left, right = parts
        owed = (left.value != _TRUE, left.value == _TRUE)
        if value == _FALSE:
            owed = (True, True)
        return [replace(left, decides=owed[0]), replace(right, decides=owed[1])]
    stop = _TRUE if op is BinaryOp.OR else _FALSE
    if value not in (_TRUE, _FALSE):
        return [replace(part, decides=bool(part.note) and part.value is None) for part in parts]
    if value != stop:
        return [replace(part, decides=True) for part in parts]
    return [replace(part, decides=part.value == stop) for part in parts]


def _flat(e: core.Expr, op: BinaryOp) -> list[core.Expr]:
    """The operands of a chain of one connective; implications are taken as they stand."""
    if not isinstance(e, core.Binary) or e.op is not op:
        return [e]
    if op is BinaryOp.IMPLIES:
        return [e.left, e.right]
    return [*_flat(e.left, op), *_flat(e.right, op)]


def _operands(e: core.Expr) -> list[core.Expr]:
    """The parts of an expression whose values are worth telling: no constants, no bare names."""
    match e:
        case core.Unary(op=UnaryOp.WIDEN, operand=operand):
            return _operands(operand)
        case core.Unary(operand=operand):
            found = [operand]
        case core.Binary(left=left, right=right):
            found = [left, right]
        case core.Builtin(arguments=arguments) | core.Call(arguments=arguments):
            found = list(arguments)
        case core.ExternalCall(arguments=arguments):
            found = list(arguments)
        case core.Select(base=base):
            found = [base]
        case core.Read(place=place):
            found = [step.index for step in place.steps if isinstance(step, core.IndexStep)]
            found += [step.key for step in place.steps if isinstance(step, core.KeyStep)]
        case core.MakeList(items=items) | core.MakeRecord(fields=items):
            found = list(items)
        case _:
            found = []
    return [_bare(part) for part in found if _tells(_bare(part))]


def _bare(e: core.Expr) -> core.Expr:
    return e.operand if isinstance(e, core.Unary) and e.op is UnaryOp.WIDEN else e


def _tells(e: core.Expr) -> bool:
    """Return whether the value of a part is not plain from its text."""
    match e:
        case core.Const() | core.NumAgents() | core.Delta() | core.Pid():
            return False
        case core.Unary(op=UnaryOp.NEG, operand=operand):
            return _tells(operand)
        case core.Read(place=place):
            return place.variable.home is not core.Home.BOUND or bool(place.steps)
        case core.MakeList(items=items) | core.MakeRecord(fields=items):
            return any(map(_tells, items))
        case _:
            return True
