"""Machine code of a graph of whole rounds, whose edges say who runs. [T-FAIR-CYCLE] [T-FULL-STATES]

It is that of a search (:mod:`rounds`), with three differences. Robots' moves say which event ran,
in a cell of the state, so that skips and runs are kept apart; the cell is read at the end of a
round, and emptied where no statement reads it. A state has a cell for whether each expectation is
owed. And each round leaves an edge: of those to one state none is kept that another one dominates.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

from koord.kernels.canonical import canonical_code
from koord.kernels.combinations import expand_one_code
from koord.kernels.context import (
    BEFORE,
    CURRENT,
    LEFT,
    LEFT_FULL,
    LEFT_TOO_MANY,
    STATE_COUNT,
    STATE_MOST,
    STATES,
    WORK,
    Context,
    Goals,
)
from koord.kernels.environment_turns import environment_turns_code, ways_of
from koord.kernels.fair_context import (
    CHAIN,
    CHAIN_ROOM,
    EDGE_COUNT,
    EDGE_DONE,
    EDGE_LABELS,
    EDGE_ROOM,
    EDGE_TARGETS,
    FIRSTS,
    LABEL,
    MARKS,
    NODE_LABELS,
)
from koord.kernels.fair_labels import LabelBits, readiness
from koord.kernels.fair_sets import FairSetCode, fair_set_code
from koord.kernels.layout import Layout
from koord.kernels.module import RoundModule
from koord.kernels.races import races_code
from koord.kernels.rounds import Rounds, expand_code, stop_all, turns_code
from koord.kernels.tables import STATE_TABLE, hash_code, insert_code, lookup_code, rehash_code
from koord.kernels.terms import Scalar
from koord.kernels.turn_code import statement_code
from koord.kernels.turns import TurnMaker
from koord.machine.code import BYTES, I1, I8, I32, I64, Code, Ir, constant, word
from koord.semantics.configurations import NO_EVENT
from koord.syntax import core

#: A statement with the number of bound variables that it needs.
Statement = tuple[core.Expr, int]


class FairRounds(Rounds):
    """The machine code of a graph of rounds. Raises NoKernelError where there is none.

    ``owed`` are the cells for what is owed, ``expected`` the trigger and the goal of each
    expectation; ``statements`` are those of which ``marks`` says where they hold.
    """

    def __init__(
        self,
        layout: Layout,
        bits: int,
        owed: Sequence[int],
        expected: Sequence[tuple[Statement, Statement]],
        statements: Sequence[Statement],
        *,
        tracks_ran: bool,
    ) -> None:
        self.labels = LabelBits.of(layout.system, len(owed))
        self._owed, self._expected, self._asked = owed, expected, statements
        self._tracks_ran = tracks_ran
        super().__init__(layout, Goals(), bits)
        self.marks = [self._loaded.function(f"marks_{k}", 2) for k in range(len(statements))]
        self.sets = FairSetCode(self._loaded.function)

    def _write(self, maker: TurnMaker) -> None:
        labels = [_node_terms(maker, self.labels, i) for i in self.of.robots]
        expected = [(maker.statement(*t), maker.statement(*g)) for t, g in self._expected]
        statements = [maker.statement(*s) for s in self._asked]
        node = tuple(chain.from_iterable(labels))
        owed = list(zip(self._owed, expected, strict=True))
        tracks_ran = self._tracks_ran
        _Writer(self.of, self.labels, node, owed, statements, tracks_ran=tracks_ran).write()


def _node_terms(maker: TurnMaker, bits: LabelBits, robot: int) -> tuple[tuple[int, Scalar], ...]:
    """The bits of a node's label that are of one robot, each with a condition.

    It is when the bit is set, and of the first one, of the robot itself, when it is not.
    """
    found = readiness(maker, robot)
    asks = ((bits.robots + bits.locks.index((robot, k)), scalar) for k, scalar in found.asks)
    return ((robot, found.ready), *asks)


class _Writer:
    """A writer of the functions that the others are called from, in the order of their calls."""

    def __init__(
        self,
        of: RoundModule,
        labels: LabelBits,
        node: tuple[tuple[int, Scalar], ...],
        owed: list[tuple[int, tuple[Scalar, Scalar]]],
        statements: list[Scalar],
        *,
        tracks_ran: bool,
    ) -> None:
        self.of, self.labels = of, labels
        self.node, self.owed, self.statements = node, owed, statements
        self.tracks_ran = tracks_ran

    def write(self) -> None:
        of = self.of
        module, cells = of.module, of.cells
        canonical_code(module, cells)
        events, turns = turns_code(of)
        hashed = hash_code(module, cells)
        self.insert = insert_code(module, cells, STATE_TABLE, "insert_state", hashed)
        self.lookup = lookup_code(module, cells, STATE_TABLE, hashed)
        rehash_code(module, cells, hashed)
        self.holds = {
            id(scalar): statement_code(module, f"statement_{k}", scalar, cells)
            for k, scalar in enumerate(self._scalars())
        }
        self.enter = self._enter()
        edge = self._edge()
        environment = environment_turns_code(of, turns, edge)
        middle = self._middle(environment, edge)
        races = races_code(of, middle)
        expand_one = expand_one_code(of, events, middle, races, ways_of(of.environments))
        tables = ((STATE_COUNT, STATE_MOST),)
        expand_code(of, expand_one, tables, begun=self._begun, ended=self._ended)
        for k, scalar in enumerate(self.statements):
            self._marks(k, scalar)
        fair_set_code(module)

    def _scalars(self) -> list[Scalar]:
        """All statements, and what labels of nodes are made of, each once."""
        scalars = [scalar for _, scalar in self.node]
        scalars += [scalar for _, pair in self.owed for scalar in pair]
        return list({id(s): s for s in [*scalars, *self.statements]}.values())

    def _is_so(self, code: Code, scalar: Scalar, state: Ir) -> Ir:
        return code.b.call(self.holds[id(scalar)], [state])

    # --- nodes ----------------------------------------------------------------------------------

    def _enter(self) -> Ir:
        """``enter(context, state)``: the number of the node of a state, which is new or not; -1
        where there is no room. The state's cells say what was owed before it. [FAIR-ASSUME]
        """
        code = Code(self.of.module, "enter", (BYTES, BYTES), I64)
        context, state = Context(code, code.arguments[0]), code.arguments[1]
        b, cells = code.b, self.of.cells
        context.add(WORK, word(1))
        for cell, (trigger, goal) in self.owed:
            before = cells.read(code, state, cell)
            raised = b.or_(before, self._is_so(code, trigger, state))
            owes = b.and_(raised, b.not_(self._is_so(code, goal, state)))
            code.put(state, cell * cells.size, cells.narrow(code, owes))
        known = b.call(self.lookup, [context.address, state])
        with b.if_then(b.icmp_signed(">=", known, word(0))):
            b.ret(known)
        number = b.call(self.insert, [context.address, state])
        with b.if_then(b.icmp_signed(">=", number, word(0))):
            current = b.trunc(context.get(CURRENT), I32)
            code.put(context.block(BEFORE), b.shl(number, word(2)), current)
            label = self._node_label(code, state)
            code.put(context.block(NODE_LABELS), b.shl(number, word(3)), label)
        b.ret(number)
        return code.function

    def _node_label(self, code: Code, state: Ir) -> Ir:
        b, label = code.b, word(0)
        for bit, scalar in self.node:
            is_so = self._is_so(code, scalar, state)
            is_set = b.not_(is_so) if bit < self.labels.robots else is_so
            label = b.or_(label, b.select(is_set, word(1 << bit), word(0)))
        for k, (cell, _) in enumerate(self.owed):
            owes = self.of.cells.read(code, state, cell)
            bit = word(1 << self.labels.first_expectation + k)
            label = b.or_(label, b.select(owes, word(0), bit))
        return label

    def _marks(self, k: int, scalar: Scalar) -> None:
        """``marks_K(context, out)``: of each node a byte that says whether a statement holds."""
        code = Code(self.of.module, f"marks_{k}", (BYTES, BYTES), I64)
        context, out = Context(code, code.arguments[0]), code.arguments[1]
        b, states, size = code.b, context.block(STATES), word(self.of.cells.state_bytes)
        with code.loop(word(0), context.get(STATE_COUNT)) as node:
            is_so = self._is_so(code, scalar, code.at(states, b.mul(node, size)))
            code.put(out, node, b.zext(is_so, I8))
        b.ret(word(0))

    # --- edges ----------------------------------------------------------------------------------

    def _middle(self, environment: Ir, edge: Ir) -> Ir:
        """``middle(context, state)``: what becomes of the end of the program turns. [END-PROG]"""
        of = self.of
        code = Code(of.module, "middle", (BYTES, BYTES), I64)
        context, state = Context(code, code.arguments[0]), code.arguments[1]
        stop_all(code, of, state)
        context.put(LABEL, self._edge_label(code, state))
        code.b.call(environment if of.has_environment else edge, [context.address, state])
        code.b.ret(word(0))
        return code.function

    def _edge_label(self, code: Code, state: Ir) -> Ir:
        """The label of what robots ran, which is forgotten where nobody reads it."""
        b, cells, system = code.b, self.of.cells, self.of.layout.system
        label = word(0)
        for i, robot in enumerate(self.of.layout.robots):
            assert robot.ran is not None
            ran = cells.read(code, state, robot.ran)
            for position, event in enumerate(system.agent(i).events):
                bits = word(self.labels.run_by(i, event.lock_classes))
                is_it = b.icmp_signed("==", ran, word(position))
                label = b.or_(label, b.select(is_it, bits, word(0)))
            if not self.tracks_ran:
                nothing = cells.narrow(code, word(NO_EVENT))
                code.put(state, robot.ran * cells.size, nothing)
        return label

    def _edge(self) -> Ir:
        """``edge(context, state)``: an edge from the current node to that of a state."""
        code = Code(self.of.module, "edge", (BYTES, BYTES), I64)
        context, b = Context(code, code.arguments[0]), code.b
        after = code.block(self.of.cells.state_bytes)
        code.copy(after, code.arguments[1], self.of.cells.state_bytes)
        target = b.call(self.enter, [context.address, after])
        with b.if_then(b.icmp_signed("<", target, word(0))):
            b.ret(word(-1))
        first, count, label = context.get(EDGE_DONE), context.get(EDGE_COUNT), context.get(LABEL)
        targets, labels = context.block(EDGE_TARGETS), context.block(EDGE_LABELS)
        place = b.shl(target, word(2))
        last = b.zext(code.get(context.block(MARKS), place, I32), I64)
        # What a mark says of another state's edges, or of none, does not count.
        is_ours = b.and_(b.icmp_signed(">=", last, first), b.icmp_signed("<", last, count))
        other, leads = code.slot(I64), code.slot(I1)
        b.store(constant(I1, 0), leads)
        with b.if_then(is_ours):
            its = b.zext(code.get(targets, b.shl(last, word(2)), I32), I64)
            b.store(b.icmp_signed("==", its, target), leads)
        b.store(b.select(b.load(leads), last, word(-1)), other)
        with code.while_(lambda: b.icmp_signed(">=", b.load(other), word(0))):
            here = b.load(other)
            its = code.get(labels, b.shl(here, word(3)), I64)
            both = b.or_(its, label)
            with b.if_then(b.icmp_signed("==", both, its)):
                b.ret(word(0))
            with b.if_then(b.icmp_signed("==", both, label)):
                code.put(labels, b.shl(here, word(3)), label)
                b.ret(word(0))
            before = code.get(context.block(CHAIN), b.shl(b.sub(here, first), word(2)), I32)
            b.store(b.sub(b.add(first, b.zext(before, I64)), word(1)), other)
            with b.if_then(b.icmp_signed("<", b.load(other), first)):
                b.store(word(-1), other)
        with b.if_then(b.icmp_signed(">=", count, context.get(EDGE_ROOM))):
            context.leave(LEFT_FULL)
            b.ret(word(-1))
        with b.if_then(b.icmp_signed(">=", b.sub(count, first), context.get(CHAIN_ROOM))):
            context.leave(LEFT_TOO_MANY)
            b.ret(word(-1))
        code.put(targets, b.shl(count, word(2)), b.trunc(target, I32))
        code.put(labels, b.shl(count, word(3)), label)
        # In the chain edges are told from the first one of the state, from 1 on; 0 is none.
        link = b.select(b.load(leads), b.add(b.sub(last, first), word(1)), word(0))
        chain = context.block(CHAIN)
        code.put(chain, b.shl(b.sub(count, first), word(2)), b.trunc(link, I32))
        code.put(context.block(MARKS), place, b.trunc(count, I32))
        context.put(EDGE_COUNT, b.add(count, word(1)))
        b.ret(word(0))
        return code.function

    def _begun(self, context: Context) -> None:
        """Forget the edges of a state that was left half done."""
        context.put(EDGE_COUNT, context.get(EDGE_DONE))

    def _ended(self, context: Context, after: Ir) -> None:
        """Keep the edges of a state: they do not count where machine code could not go on."""
        code = context.code
        with code.b.if_then(code.b.icmp_signed("==", context.get(LEFT), word(0))):
            done = context.get(EDGE_COUNT)
            context.put(EDGE_DONE, done)
            code.put(context.block(FIRSTS), code.b.shl(after, word(3)), done)
