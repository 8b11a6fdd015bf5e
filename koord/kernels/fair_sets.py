"""Machine code that looks for fair sets in a graph. [T-FAIR-CYCLE]

Components are numbered so that no edge leads from one to one with a greater number, and this is
looked at again once they are made: then a cycle is within nodes of one number, whatever was done to
find them. The code is the same for all graphs. ``label`` is what :mod:`fair_labels` says; one more
bit of the labels of a component says that it has an edge inside.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from koord.kernels.context import STATE_COUNT, Context
from koord.kernels.fair_context import EDGE_LABELS, EDGE_TARGETS, FIRSTS, NODE_LABELS
from koord.machine.code import BYTES, I8, I32, I64, Code, Ir, constant, word

#: Set in the label of a component that has an edge inside.
INNER = 1 << 61


class FairSetCode:
    """The functions, as loaded; each has a context as its first argument.

    Sets of nodes are a byte a node, numbers of components 32 bits a node, labels 64 bits a
    component. ``components`` gives how many there are among the nodes of ``alive`` that ``roots``
    lead to, and puts their numbers, from 1 on, into ``parts``; of all other nodes that is 0.
    ``flaws`` counts what is wrong with such numbers, ``summaries`` adds up labels, ``kinds`` keeps
    those that differ. ``prune`` leaves alive what may have a fair part: it gives the number of a
    fair component, 0 if no node is left, else -1.
    """

    def __init__(self, function: Callable[[str, int], Callable[..., int]]) -> None:
        self.components = function("components", 5)
        self.flaws = function("flaws", 4)
        self.summaries = function("summaries", 4)
        self.kinds = function("kinds", 5)
        self.prune = function("prune", 7)


def fair_set_code(module: Any) -> None:
    """Write the functions into a module."""
    _components(module)
    _flaws(module)
    _summaries(module)
    _kinds(module)
    _prune(module)


class _Reader:
    """Nodes and edges in the body of one function."""

    def __init__(self, code: Code, context: Context) -> None:
        self.code, self.b = code, code.b
        self.count = context.get(STATE_COUNT)
        self.firsts, self.targets = context.block(FIRSTS), context.block(EDGE_TARGETS)
        self.edge_labels, self.node_labels = context.block(EDGE_LABELS), context.block(NODE_LABELS)

    def byte(self, block: Ir, node: Ir) -> Ir:
        """Whether a byte of a set is not zero."""
        return self.b.icmp_signed("!=", self.code.get(block, node, I8), constant(I8, 0))

    def half(self, block: Ir, place: Ir) -> Ir:
        """A number of 32 bits."""
        return self.b.zext(self.code.get(block, self.b.shl(place, word(2)), I32), I64)

    def put_half(self, block: Ir, place: Ir, value: Ir) -> None:
        self.code.put(block, self.b.shl(place, word(2)), self.b.trunc(value, I32))

    def whole(self, block: Ir, place: Ir) -> Ir:
        """A number of 64 bits."""
        return self.code.get(block, self.b.shl(place, word(3)), I64)

    def put_whole(self, block: Ir, place: Ir, value: Ir) -> None:
        self.code.put(block, self.b.shl(place, word(3)), value)

    def first(self, node: Ir) -> Ir:
        """The number of the first edge of a node."""
        return self.whole(self.firsts, node)

    def end(self, node: Ir) -> Ir:
        """The number behind that of the last edge of a node."""
        return self.first(self.b.add(node, word(1)))


def _components(module: Any) -> None:
    """``components(context, roots, alive, parts, space)`` (Tarjan), without recursion.

    ``space`` is zeroed and has 24 bytes a node, and 8 more.
    """
    code = Code(module, "components", (BYTES,) * 5, I64)
    address, roots, alive, parts, space = code.arguments
    of = _Reader(code, Context(code, address))
    b, count = code.b, of.count
    size4 = b.shl(count, word(2))
    places = space
    index = code.at(places, b.shl(count, word(3)))
    low, open_, walk = (code.at(index, b.mul(size4, word(k))) for k in (1, 2, 3))
    seen, opened, depth, found = (code.slot(I64) for _ in range(4))
    for slot in (seen, opened, depth, found):
        b.store(word(0), slot)
    with code.loop(word(0), count) as node:
        of.put_half(parts, node, word(0))

    def visit(node: Ir) -> None:
        number = b.add(b.load(seen), word(1))
        b.store(number, seen)
        of.put_half(index, node, number)
        of.put_half(low, node, number)
        of.put_half(open_, b.load(opened), node)
        b.store(b.add(b.load(opened), word(1)), opened)
        of.put_half(walk, b.load(depth), node)
        b.store(b.add(b.load(depth), word(1)), depth)
        of.put_whole(places, node, of.first(node))

    def lower(node: Ir, to: Ir) -> None:
        now = of.half(low, node)
        of.put_half(low, node, b.select(b.icmp_unsigned("<", to, now), to, now))

    def close(node: Ir) -> None:
        """Take the nodes of a component from those that are open."""
        b.store(b.add(b.load(found), word(1)), found)
        is_more = code.slot(I64)
        b.store(word(1), is_more)
        with code.while_(lambda: b.icmp_signed("!=", b.load(is_more), word(0))):
            b.store(b.sub(b.load(opened), word(1)), opened)
            one = of.half(open_, b.load(opened))
            of.put_half(parts, one, b.load(found))
            b.store(b.zext(b.icmp_signed("!=", one, node), I64), is_more)

    def step() -> None:
        node = of.half(walk, b.sub(b.load(depth), word(1)))
        place = of.whole(places, node)
        with b.if_else(b.icmp_signed("<", place, of.end(node))) as (more, done):
            with more:
                of.put_whole(places, node, b.add(place, word(1)))
                after = of.half(of.targets, place)
                with b.if_then(of.byte(alive, after)):
                    number = of.half(index, after)
                    with b.if_else(b.icmp_signed("==", number, word(0))) as (new, known):
                        with new:
                            visit(after)
                        with known:
                            is_open = b.icmp_signed("==", of.half(parts, after), word(0))
                            with b.if_then(is_open):
                                lower(node, number)
            with done:
                b.store(b.sub(b.load(depth), word(1)), depth)
                with b.if_then(b.icmp_signed(">", b.load(depth), word(0))):
                    lower(of.half(walk, b.sub(b.load(depth), word(1))), of.half(low, node))
                is_root = b.icmp_signed("==", of.half(low, node), of.half(index, node))
                with b.if_then(is_root):
                    close(node)

    with code.loop(word(0), count) as root:
        is_new = b.icmp_signed("==", of.half(index, root), word(0))
        both = b.and_(of.byte(roots, root), of.byte(alive, root))
        with b.if_then(b.and_(is_new, both)):
            visit(root)
            with code.while_(lambda: b.icmp_signed(">", b.load(depth), word(0))):
                step()
    b.ret(b.load(found))


def _flaws(module: Any) -> None:
    """``flaws(context, roots, alive, parts)``: how often numbers of components are no proof.

    Each root that is alive has to have one, what is not alive has none, and an edge to what is
    alive leads to a number that is not greater.
    """
    code = Code(module, "flaws", (BYTES,) * 4, I64)
    address, roots, alive, parts = code.arguments
    of = _Reader(code, Context(code, address))
    b, flaws = code.b, code.slot(I64)
    b.store(word(0), flaws)

    def note(is_wrong: Ir) -> None:
        b.store(b.add(b.load(flaws), b.zext(is_wrong, I64)), flaws)

    with code.loop(word(0), of.count) as node:
        part, lives = of.half(parts, node), of.byte(alive, node)
        is_in = b.icmp_signed("!=", part, word(0))
        note(b.and_(b.and_(of.byte(roots, node), lives), b.not_(is_in)))
        note(b.and_(is_in, b.not_(lives)))
        with b.if_then(is_in), code.loop(of.first(node), of.end(node)) as edge:
            after = of.half(of.targets, edge)
            its = of.half(parts, after)
            is_low = b.and_(b.icmp_signed("!=", its, word(0)), b.icmp_signed("<=", its, part))
            note(b.and_(of.byte(alive, after), b.not_(is_low)))
    b.ret(b.load(flaws))


def _summaries(module: Any) -> None:
    """``summaries(context, parts, edges, nodes)``: the labels of components, added up.

    ``edges`` and ``nodes`` are zeroed. Of edges those within a component count.
    """
    code = Code(module, "summaries", (BYTES,) * 4, I64)
    address, parts, edges, nodes = code.arguments
    of = _Reader(code, Context(code, address))
    b = code.b

    def add(block: Ir, place: Ir, label: Ir) -> None:
        of.put_whole(block, place, b.or_(of.whole(block, place), label))

    with code.loop(word(0), of.count) as node:
        part = of.half(parts, node)
        with b.if_then(b.icmp_signed("!=", part, word(0))):
            add(nodes, part, of.whole(of.node_labels, node))
            with code.loop(of.first(node), of.end(node)) as edge:
                its = of.half(parts, of.half(of.targets, edge))
                with b.if_then(b.icmp_signed("==", its, part)):
                    add(edges, part, b.or_(of.whole(of.edge_labels, edge), word(INNER)))
    b.ret(word(0))


def _kinds(module: Any) -> None:
    """``kinds(edges, nodes, count, out, room)``: the different pairs of components' labels.

    Of those with an edge inside; it gives how many there are, and stops behind ``room``.
    """
    code = Code(module, "kinds", (BYTES, BYTES, I64, BYTES, I64), I64)
    edges, nodes, count, out, room = code.arguments
    b, found = code.b, code.slot(I64)
    b.store(word(0), found)
    with code.loop(word(1), b.add(count, word(1))) as part:
        place = b.shl(part, word(3))
        its, theirs = code.get(edges, place, I64), code.get(nodes, place, I64)
        with b.if_then(b.icmp_signed("!=", b.and_(its, word(INNER)), word(0))):
            is_new = code.slot(I64)
            b.store(word(1), is_new)
            with code.loop(word(0), b.load(found)) as other:
                there = b.shl(other, word(4))
                one = b.xor(code.get(out, there, I64), its)
                two = b.xor(code.get(code.at(out, 8), there, I64), theirs)
                with b.if_then(b.icmp_signed("==", b.or_(one, two), word(0))):
                    b.store(word(0), is_new)
            with b.if_then(b.icmp_signed("!=", b.load(is_new), word(0))):
                with b.if_then(b.icmp_signed(">=", b.load(found), room)):
                    b.ret(b.add(room, word(1)))
                there = b.shl(b.load(found), word(4))
                code.put(out, there, its)
                code.put(code.at(out, 8), there, theirs)
                b.store(b.add(b.load(found), word(1)), found)
    b.ret(b.load(found))


def _prune(module: Any) -> None:
    """``prune(context, parts, edges, nodes, alive, met, granted)``.

    ``met`` and ``granted`` are the bits that are wanted of each set, and of each that asks. Of the
    nodes that are alive those stay that may be in a fair set.
    """
    code = Code(module, "prune", (BYTES, BYTES, BYTES, BYTES, BYTES, I64, I64), I64)
    address, parts, edges, nodes, alive, met, granted = code.arguments
    of = _Reader(code, Context(code, address))
    b, left = code.b, code.slot(I64)
    b.store(word(0), left)
    with code.loop(word(0), of.count) as node:
        part = of.half(parts, node)
        its, theirs = of.whole(edges, part), of.whole(nodes, part)
        # Component 0 is of nodes that do not count: it has no edge inside.
        has_edge = b.icmp_signed("!=", b.and_(its, word(INNER)), word(0))
        missing = b.and_(met, b.not_(b.or_(its, theirs)))
        may_be = b.and_(has_edge, b.icmp_signed("==", missing, word(0)))
        denied = b.and_(b.and_(theirs, granted), b.not_(its))
        with b.if_then(b.and_(may_be, b.icmp_signed("==", denied, word(0)))):
            b.ret(part)
        asks = b.and_(of.whole(of.node_labels, node), denied)
        stays = b.and_(may_be, b.icmp_signed("==", asks, word(0)))
        code.put(alive, node, b.zext(stays, I8))
        b.store(b.or_(b.load(left), b.select(stays, word(-1), word(0))), left)
    b.ret(b.load(left))
