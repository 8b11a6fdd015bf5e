"""Export of circuits: AIGER for model checkers, VMT and SMT-LIB for solvers.

Where INIT leads to one state, latches start as they are there. Elsewhere INIT is a first step,
before which latches are false, and a latch ``begun`` says that it was made. A latch ``valid`` says
that all steps so far were legal, unless all are; nothing is bad without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from koord.verify.engines.bits.circuit import Circuit, Latch
from koord.verify.engines.bits.clauses import QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import whatever_range
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery, reduced
from koord.verify.engines.bits.legal_choices import choices_of, legal_mistakes, legal_rounds
from koord.verify.engines.bits.unrolling import Copy


class Format(Enum):
    """The file formats of a circuit."""

    AIGER = "aiger"  #: ASCII, version 1.9, one bad literal for each claim
    AIG = "aig"  #: the same in its binary form
    VMT = "vmt"  #: a transition system in SMT-LIB, for tools like nuXmv and ic3ia
    SMT2 = "smt2"  #: the question whether a claim breaks within the bound, for any SMT solver


class TransitionSystem(Struct, frozen=True):
    """A transition system with its bad literals by name. Latches start as constants."""

    graph: Graph
    inputs: tuple[int, ...]
    latches: tuple[Latch, ...]
    bad: tuple[tuple[str, int], ...]


class _Badness(Struct, frozen=True):
    """When a claim breaks: as INIT ends, and after INIT, by a state and inputs."""

    name: str
    first: int
    later: int


def machine_of(circuit: Circuit, *, between: bool = True) -> TransitionSystem:
    """The circuit's transition system.

    A claim is bad in the step that breaks it, or, if that is as good and claims may be looked at
    ``between`` rounds, in the state behind it. Without that INIT is always the first step.
    """
    g, choices = circuit.d.graph, choices_of(circuit)
    steps, in_rounds, in_states = whatever_range(circuit, between=between)
    lost = legal_mistakes(g, g.both(circuit.lost, steps), choices)
    bad = []
    for claim in circuit.bad:
        breaks = legal_mistakes(g, in_rounds.get(claim, FALSE), choices)
        later = g.any_of([breaks, in_states.get(claim, FALSE), lost])
        bad.append(_Badness(claim.name, circuit.bad_start.get(claim, FALSE), later))
    steps, latches = legal_rounds(g, steps, circuit.latches, choices)
    # What nobody asks about, like the event that a robot ran last, is none of it.
    latches = _own_first(reduced(latches, g.cone, [steps, *(x.later for x in bad)]))
    if between and _is_determined(g, latches, circuit.opens, bad):
        return _after_init(g, latches, steps, bad)
    return _with_init(g, latches, circuit.opens, steps, bad)


def machine_asking(g: Graph, question: SafetyQuery) -> TransitionSystem:
    """The transition system of an IC3 query; latches of the query are l0, l1, …"""
    steps = g.all_of([question.steps, *question.given])
    bad = [_Badness("bad", FALSE, g.all_of([question.bad, *question.given]))]
    latches = [replace(latch, name=f"l{k}") for k, latch in enumerate(question.latches)]
    if _is_determined(g, latches, question.opens, bad):
        return _after_init(g, latches, steps, bad)
    return _with_init(g, latches, question.opens, steps, bad)


def _own_first(latches: Iterable[Latch]) -> tuple[Latch, ...]:
    """Latches in order: robots' own variables, then what they share.

    PDR leaves out literals of a cube in the order of latches.
    """
    return tuple(sorted(latches, key=lambda latch: "@" not in latch.name))


def _is_determined(g: Graph, latches: Sequence[Latch], opens: int, bad: Sequence[_Badness]) -> bool:
    """Return whether INIT leads to one state, and breaks nothing on the way."""
    if any(latch.init > TRUE for latch in latches) or any(x.first != FALSE for x in bad):
        return False
    clauses = Clauses(g, QUICK)
    possible = clauses.solve([clauses.of(opens)])
    clauses.close()
    return possible


def _after_init(
    g: Graph, latches: Sequence[Latch], steps: int, bad: Sequence[_Badness]
) -> TransitionSystem:
    """A transition system that starts behind INIT, where that leads to one state."""
    if steps == TRUE:
        return _system(g, latches, [(x.name, x.later) for x in bad])
    valid = g.input("valid")
    legal = Latch("valid", valid, TRUE, g.both(valid, steps))
    return _system(g, [legal, *latches], [(x.name, g.both(valid, x.later)) for x in bad])


def _with_init(
    g: Graph, given: Sequence[Latch], opens: int, steps: int, bad: Sequence[_Badness]
) -> TransitionSystem:
    """A transition system with INIT as its first step, before which all latches are false."""
    begun, valid = g.input("begun"), g.input("valid")
    legal = g.choose(begun, g.both(valid, steps), opens)
    latches = [Latch("begun", begun, FALSE, TRUE), Latch("valid", valid, FALSE, legal)]
    for latch in given:
        then = g.choose(begun, latch.next, latch.init)
        latches.append(Latch(latch.name, latch.literal, FALSE, then))
    when = [
        (x.name, g.either(g.all_of([begun, valid, x.later]), g.both(begun ^ 1, x.first)))
        for x in bad
    ]
    return _system(g, latches, when)


def _system(g: Graph, latches: Sequence[Latch], bad: Sequence[tuple[str, int]]) -> TransitionSystem:
    own = {latch.literal >> 1 for latch in latches}
    roots = [*(latch.next for latch in latches), *(x for _, x in bad)]
    inputs = tuple(2 * n for n in g.cone(roots) if g.is_input(n) and n not in own)
    return TransitionSystem(g, inputs, tuple(latches), tuple(bad))


def exported(circuit: Circuit, format_: Format, rounds: int, comment: str) -> bytes:
    """The text of a file. ``rounds`` is the depth of an SMT-LIB query."""
    of = machine_of(circuit, between=format_ is not Format.SMT2)
    match format_:
        case Format.AIGER:
            return _text(_aiger(of, comment))
        case Format.AIG:
            return _aig(of, comment)
        case Format.VMT:
            return _text(_vmt(of, comment))
        case Format.SMT2:
            return _text(_smt2(of, rounds, comment))


def aiger_of(of: TransitionSystem) -> bytes:
    """The transition system in the binary form of AIGER."""
    return _aig(of, "")


def _text(lines: Iterable[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()


# --- AIGER ----------------------------------------------------------------------------------------


class _Numbered:
    """A numbering of inputs, latches and conjunctions, in this order, each after its operands."""

    def __init__(self, of: TransitionSystem) -> None:
        self._numbers = {0: 0}
        for literal in (*of.inputs, *(latch.literal for latch in of.latches)):
            self._numbers[literal >> 1] = len(self._numbers)
        assert len(self._numbers) == 1 + len(of.inputs) + len(of.latches)
        g = of.graph
        nodes = [n for n in _cone(of) if not g.is_input(n)]
        for node in nodes:
            self._numbers[node] = len(self._numbers)
        #: Each conjunction with what it is made of, the larger one first.
        self.conjunctions = [
            (self.of(2 * n), *sorted((self.of(g.left[n]), self.of(g.right[n])), reverse=True))
            for n in nodes
        ]

    def of(self, literal: int) -> int:
        return 2 * self._numbers[literal >> 1] + (literal & 1)

    def becomes(self, latch: Latch) -> str:
        """The next value of a latch, and what it starts as unless that is false."""
        return f"{self.of(latch.next)}{' 1' if latch.init == TRUE else ''}"

    def header(self, kind: str, of: TransitionSystem) -> str:
        sizes = len(of.inputs), len(of.latches), 0, len(self.conjunctions), len(of.bad)
        return f"{kind} {len(self._numbers) - 1} {' '.join(map(str, sizes))}"


def _aiger(of: TransitionSystem, comment: str) -> Iterator[str]:
    numbered = _Numbered(of)
    yield numbered.header("aag", of)
    yield from (str(numbered.of(literal)) for literal in of.inputs)
    yield from (f"{numbered.of(x.literal)} {numbered.becomes(x)}" for x in of.latches)
    yield from (str(numbered.of(literal)) for _, literal in of.bad)
    yield from (f"{node} {left} {right}" for node, left, right in numbered.conjunctions)
    yield from _symbols(of, comment)


def _aig(of: TransitionSystem, comment: str) -> bytes:
    """The binary AIGER file: inputs and latches are implicit, conjunctions are differences."""
    numbered = _Numbered(of)
    head = [numbered.header("aig", of)]
    head += [numbered.becomes(latch) for latch in of.latches]
    head += [str(numbered.of(literal)) for _, literal in of.bad]
    body = bytearray()
    for node, left, right in numbered.conjunctions:
        for difference in (node - left, left - right):
            body.extend(_seven_bits_each(difference))
    return _text(head) + bytes(body) + _text(_symbols(of, comment))


def _seven_bits_each(number: int) -> Iterator[int]:
    """Encode a number in bytes of seven bits, lowest first; the high bit says that more follow."""
    while number > 0x7F:
        yield number & 0x7F | 0x80
        number >>= 7
    yield number


def _symbols(of: TransitionSystem, comment: str) -> Iterator[str]:
    """The symbol table, with names made unique, as some tools require."""
    seen: Counter[str] = Counter()
    named = [(f"i{k}", of.graph.names[x >> 1]) for k, x in enumerate(of.inputs)]
    named += [(f"l{k}", latch.name) for k, latch in enumerate(of.latches)]
    for key, name in named:
        seen[name] += 1
        yield f"{key} {name}" if seen[name] == 1 else f"{key} {name} #{seen[name]}"
    yield from (f"b{k} {name}" for k, (name, _) in enumerate(of.bad))
    yield "c"
    yield comment


def _cone(of: TransitionSystem) -> list[int]:
    return of.graph.cone([*(latch.next for latch in of.latches), *(x for _, x in of.bad)])


# --- SMT-LIB --------------------------------------------------------------------------------------


def _vmt(of: TransitionSystem, comment: str) -> Iterator[str]:
    g = of.graph
    yield f"; {comment}"
    names = {0: "false"}
    for literal in of.inputs:
        names[literal >> 1] = _symbol(g.names[literal >> 1], literal)
        yield f"(declare-fun {names[literal >> 1]} () Bool)"
    for latch in of.latches:
        name = names[latch.literal >> 1] = _symbol(latch.name, latch.literal)
        then = _symbol(f"next {latch.name}", latch.literal)
        yield f"(declare-fun {name} () Bool)"
        yield f"(declare-fun {then} () Bool)"
        yield f"(define-fun |.{latch.literal}| () Bool (! {name} :next {then}))"
    yield from _definitions(g, _cone(of), names)
    starts = _all(_term(latch.literal ^ latch.init ^ 1, names) for latch in of.latches)
    yield f"(define-fun |.init| () Bool (! {starts} :init true))"
    steps = _all(
        f"(= {_symbol(f'next {latch.name}', latch.literal)} {_term(latch.next, names)})"
        for latch in of.latches
    )
    yield f"(define-fun |.trans| () Bool (! {steps} :trans true))"
    for k, (name, literal) in enumerate(of.bad):
        yield f"; {name}"
        yield (
            f"(define-fun |.bad{k}| () Bool (! {_term(literal ^ 1, names)} :invar-property {k}))"
        )


def _smt2(of: TransitionSystem, rounds: int, comment: str) -> Iterator[str]:
    """A script that is satisfiable if a claim breaks in INIT or within so many rounds."""
    to = Graph()
    state = {latch.literal >> 1: latch.init for latch in of.latches}
    bad = []
    for number in range(rounds + 1):
        step = Copy(of.graph, to, f"#{number}", dict(state))
        bad += [step.of(literal) for _, literal in of.bad]
        state = {latch.literal >> 1: step.of(latch.next) for latch in of.latches}
    question = to.any_of(bad)
    yield f"; {comment}"
    yield "(set-logic QF_UF)"
    names = {0: "false"}
    nodes = to.cone([question])
    for node in nodes:
        if to.is_input(node):
            names[node] = _symbol(to.names[node], 2 * node)
            yield f"(declare-fun {names[node]} () Bool)"
    yield from _definitions(to, nodes, names)
    yield f"(assert {_term(question, names)})"
    yield "(check-sat)"


def _definitions(g: Graph, nodes: Sequence[int], names: dict[int, str]) -> Iterator[str]:
    for node in nodes:
        if not g.is_input(node):
            both = f"(and {_term(g.left[node], names)} {_term(g.right[node], names)})"
            yield f"(define-fun n{node} () Bool {both})"
            names[node] = f"n{node}"


def _term(literal: int, names: dict[int, str]) -> str:
    name = names[literal >> 1]
    return f"(not {name})" if literal & 1 else name


def _symbol(name: str, literal: int) -> str:
    """A unique name, quoted in bars."""
    return f"|{name.replace('|', '!').replace(chr(92), '/')} {literal >> 1}|"


def _all(terms: Iterable[str]) -> str:
    return f"(and true {' '.join(terms)})"
