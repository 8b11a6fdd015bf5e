"""A system as a circuit: latches for robots and store, inputs for what is left open."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, cast

from msgspec import Struct, field

from koord.semantics.configurations import Configuration
from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.syntax.types import INT
from koord.syntax.walk import nodes
from koord.verify.claims import Claim, ClaimPhase, StepFindings
from koord.verify.encoding.moments import SymbolicConfiguration, SymbolicInit, SymbolicRound
from koord.verify.encoding.rounds import Encoder
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.unrolling import assumed, violations
from koord.verify.engines.bits import numbers
from koord.verify.engines.bits.axioms import Axioms
from koord.verify.engines.bits.cells import (
    BitUnknowns,
    Fixed,
    Joining,
    Leaf,
    OpaqueCell,
    Pairing,
    Ranged,
    Truth,
    VariableNames,
    Wild,
)
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits, Range, literal
from koord.verify.engines.bits.graph import FALSE, TRUE
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import Argument, Known, OpaqueChoice

#: Integers are followed through this range at first, and lists to so many elements; then further.
LEVELS = ((63, 8), (1023, 12), (16383, 16))

#: Where the ranges of numbers are looked for: rounds without, with, and with great leaps.
PASSES = (3, 8, 20)


class Latch(Struct, frozen=True):
    """One bit of the state: its input, its value after INIT, and its next value."""

    name: str
    literal: int
    init: int
    next: int


class Circuit(Struct, frozen=True):
    """The circuit of a system: latches, constraints, and the bad literals of claims.

    ``opens`` holds of the inputs of INIT that lead to a configuration, ``steps`` of a state and
    inputs that make a whole round. ``bad`` says of each claim in which phase of a round it breaks
    and when, ``bad_start`` when INIT breaks it, and ``held`` when the state itself keeps it.
    ``bad`` is what is ``broken`` together with all that is ``needed`` for the phase to come;
    ``steps`` is what is needed for a whole round and no fault. ``lost`` is when lists outgrow their
    room: behind it nothing is known.
    """

    d: BitDomain
    latches: tuple[Latch, ...]
    opens: int
    steps: int
    lost: int
    bad_start: dict[Claim, int]
    bad: dict[Claim, tuple[tuple[ClaimPhase, int], ...]]
    broken: dict[Claim, tuple[tuple[ClaimPhase, int], ...]]
    needed: dict[ClaimPhase, tuple[int, ...]]
    faults: tuple[int, ...]  #: of the program's turns, and of the environment's
    held: dict[Claim, int]
    opening: SymbolicInit
    start: Configuration[Bits]
    round: SymbolicRound
    unknowns: tuple[BitUnknowns, BitUnknowns]
    tokens: dict[
        int, tuple[OpaqueChoice, OpaqueChoice]
    ]  #: what standing tokens become: by INIT, by a round
    limits: tuple[str, ...]
    strays: tuple[str, ...]  #: variables some values of which are not followed
    ranges: tuple[Number, ...] = ()  #: the numbers of the state: all that is reached is in range

    def kept_by_states(self, claims: Iterable[Claim]) -> list[int]:
        """When a state keeps claims, each, of those of which it says so."""
        return [self.held[claim] for claim in claims if claim in self.held]


def circuit_of(system: System, claims: Sequence[Claim], level: int = 0) -> Circuit:
    """Build the circuit of a system; the level says how far numbers and lists are tracked.

    Raises :class:`NotFiniteError` where a loop has no bound that is known.
    """
    builder = _Builder(system, claims, level)
    while not builder.tried():
        pass
    return builder.finished()


class _Builder(Struct):
    """A fixed point over the shapes of the state: rounds are built until nothing new appears."""

    system: System
    claims: Sequence[Claim]
    level: int
    leaves: Configuration[Leaf] | None = None
    ranges: dict[str, Range] = field(default_factory=dict)
    tries: int = 0
    d: BitDomain = field(default_factory=BitDomain)
    made: dict[str, tuple[Leaf, Bits]] = field(default_factory=dict)
    marks: tuple[int, ...] = ()
    _parts: _Parts | None = None

    def tried(self) -> bool:
        """Build INIT and one round from the shapes so far. Return whether nothing new appeared."""
        self.tries += 1
        if self.tries > sum(PASSES):
            raise NotFiniteError(NOWHERE, "the values of the variables keep changing in kind")
        self.d = d = BitDomain(ranges=self.ranges)
        self.made = {}
        first = BitUnknowns(cast(Any, d), self.system.program, self.system.robots)
        opening = Encoder(self.system, first).initial()
        initial = cast("Configuration[Bits]", opening.moment.configuration)
        opened = [*opening.moment.constraints, *assumed(self.system, cast(Any, d), opening.moment)]
        before = self.leaves
        known = self._joined(before, initial)
        required, d.required = d.required, []
        start = self._started(known)
        d.opaques.part = 1
        second = BitUnknowns(cast(Any, d), self.system.program, self.system.robots)
        taken = Encoder(self.system, second).round(cast(Any, start), "r")
        self.leaves = self._joined(known, cast("Configuration[Bits]", taken.end.configuration))
        self._parts = _Parts(opening, opened, first, required, start, second, taken)
        if self._learned():
            self.leaves = None
            return False
        return self.leaves == before

    def _joined(
        self, leaves: Configuration[Leaf] | None, values: Configuration[Bits]
    ) -> Configuration[Leaf]:
        most, room = LEVELS[self.level]
        is_overtime = self.tries > PASSES[0]
        self.marks = self.marks or _landmarks(self.system, most)
        marks = self.marks
        leaps = self.tries > PASSES[1]
        if leaps:
            marks = (marks[0], marks[-1])
        joining = Joining(self.d, marks, is_overtime, forgets=leaps)

        def pair(path: str, leaf: Leaf | None, value: Bits | None) -> Leaf:
            if value is None:
                assert leaf is not None
                return leaf
            return joining.joined(leaf, value)

        def alone(path: str, value: Bits | None, same: Bits | None) -> Leaf:
            return pair(path, None, value)

        names = names_of(self.system)
        if leaves is None:
            return Pairing[Bits, Bits, Leaf](alone, _unheeded, 0, names).configuration(
                values, values
            )
        return Pairing[Leaf, Bits, Leaf](pair, _unheeded, room, names).configuration(leaves, values)

    def _started(self, leaves: Configuration[Leaf]) -> Configuration[Bits]:
        """The state as fresh bits."""

        def made(path: str, leaf: Leaf | None, same: Leaf | None) -> Bits:
            assert leaf is not None
            value = _fresh(self.d, path, leaf)
            self.made[path] = (leaf, value)
            return value

        names = names_of(self.system)
        return Pairing[Leaf, Leaf, Bits](made, _unheeded, 0, names).configuration(leaves, leaves)

    def _learned(self) -> bool:
        """Return whether constraints narrowed the ranges of inputs further."""
        assert self._parts is not None
        p = self._parts
        g = self.d.graph
        said = p.first.constraints + p.opened + p.second.constraints
        said += p.taken.end.constraints
        found = self.d.learned(g.all_of(_literals(said)))
        new = {
            name: bounds
            for name, bounds in found.items()
            if None not in bounds and self.ranges.get(name) is None
        }
        self.ranges |= new
        return bool(new)

    # --- the circuit ----------------------------------------------------------------------------

    def finished(self) -> Circuit:
        """The circuit of the last iteration."""
        assert self._parts is not None
        assert self.leaves is not None
        p, d, g = self._parts, self.d, self.d.graph
        d.opaques.part = 0
        starts, needed_first = self._broken(p.opening.moment)
        d.opaques.part = 1
        moments = [m for m in (p.taken.inside, p.taken.middle, p.taken.end) if m is not None]
        found = [self._broken(moment) for moment in moments]
        checks = SymbolicInputs(p.second, "start")
        here = SymbolicConfiguration(
            ClaimPhase.INIT, cast(Any, p.start), [], StepFindings(cast(Any, False)), checks
        )
        kept, needed = self._broken(here)
        needed = [*needed, *(x for _, more in found for x in more)]
        lost: list[int] = []
        landing = _Landing(d, self.made, lost)
        after = landing.states(self.system, self.leaves, p.taken.end.configuration)
        g_lost = g.any_of(lost)
        d.required, required = [], d.required
        d.opaques.part = 0
        landing.tokens = {}
        initially = landing.states(self.system, self.leaves, p.opening.moment.configuration)
        tokens = _tokens(self.made, initially[1], after[1])
        axioms = Axioms(self.system, d)
        relations = _relations(d, axioms, tokens)
        opens = _literals((*p.first.constraints, *p.opened, *needed_first))
        opens += [*p.required, *d.required, *axioms.of(0)]
        fault = literal(cast(Bits, p.opening.moment.findings.fault))
        base = _literals((*p.second.constraints, *needed))
        base += [*required, *axioms.of(1)]
        ranges = tuple(_ranged(self.made.values()))
        base += [x for number in ranges for x in d.in_range(number) if x != TRUE]
        program = _literals(p.taken.middle.constraints)
        whole = program + _literals(p.taken.urgency)
        ended = whole + _literals(p.taken.end.constraints)
        sound = literal(cast(Bits, p.taken.middle.findings.fault)) ^ 1
        sound_end = literal(cast(Bits, p.taken.end.findings.fault)) ^ 1
        needs = {
            ClaimPhase.INSIDE: [*base, *program],
            ClaimPhase.MIDDLE: [*base, *whole],
            ClaimPhase.END: [*base, *ended, sound],
        }
        bad: dict[Claim, tuple[tuple[ClaimPhase, int], ...]] = {claim: () for claim in self.claims}
        broken = dict(bad)
        for moment, (violated, _) in zip(moments, found, strict=True):
            for claim, when in violated.items():
                here_bad = g.both(g.all_of(needs[moment.phase]), when)
                bad[claim] = (*bad[claim], (moment.phase, here_bad))
                broken[claim] = (*broken[claim], (moment.phase, when))
        latches = [
            Latch(name, x, initially[0].get(x, FALSE), after[0].get(x, FALSE))
            for name, x in landing.names.items()
        ]
        return Circuit(
            d,
            (*latches, *relations),
            g.all_of([*opens, fault ^ 1]),
            g.all_of([*base, *ended, sound, sound_end]),
            g_lost,
            {claim: g.both(g.all_of(opens), when) for claim, when in starts.items()},
            bad,
            broken,
            {phase: tuple(parts) for phase, parts in needs.items()},
            (sound ^ 1, sound_end ^ 1),
            {claim: when ^ 1 for claim, when in kept.items()},
            p.opening,
            p.start,
            p.taken,
            (p.first, p.second),
            tokens,
            tuple(sorted({*p.first.limits, *p.second.limits})),
            tuple(path for path, (leaf, _) in self.made.items() if _is_loose(leaf)),
            ranges,
        )

    def _broken(self, moment: SymbolicConfiguration) -> tuple[dict[Claim, int], list[Bits]]:
        """The conditions under which a moment breaks claims, and the constraints on its inputs."""
        asked = violations(self.system, cast(Any, self.d), moment, self.claims)
        when = {claim: literal(cast(Bits, violated)) for claim, (violated, _) in asked.items()}
        return when, [cast(Bits, x) for _, needed in asked.values() for x in needed]


class _Parts(Struct, frozen=True):
    """The result of one iteration: INIT and a round, each with its unknowns."""

    opening: SymbolicInit
    opened: list[Any]
    first: BitUnknowns
    required: list[int]
    start: Configuration[Bits]
    second: BitUnknowns
    taken: SymbolicRound


def _literals(values: Iterable[object]) -> list[int]:
    """The literals of some Booleans."""
    return [literal(cast(Bits, x)) for x in values]


def _unheeded(length: object, room: int) -> None:
    """Ignore a list that grew."""


def names_of(system: System) -> VariableNames:
    """The names of the variables of a system."""
    program = system.program
    return VariableNames(
        tuple(x.variable.name for x in program.allread),
        tuple(x.variable.name for x in program.allwrite),
        tuple(tuple(x.variable.name for x in a.locals) for a in program.agents),
        tuple(tuple(p.declaration.variable.name for p in a.ports) for a in program.agents),
    )


def _landmarks(system: System, most: int) -> tuple[int, ...]:
    """Integers of the program's text and those near them: candidates for the bounds of ranges."""
    found = {-most - 1, most, 0, system.robots}
    for node in nodes(system.program):
        if isinstance(node, core.Const) and isinstance(node.value, int):
            # What cannot even be doubled is no end of a range: sums would be of any value at once.
            size = abs(int(node.value)) + 1
            if numbers.is_kept(-2 * size, 2 * size):
                found |= {int(node.value) + k for k in (-1, 0, 1)}
    return tuple(sorted(found))


def _fresh(d: BitDomain, path: str, leaf: Leaf) -> Bits:
    match leaf:
        case Fixed(value=value):
            return value
        case Truth():
            return Bit(d.graph.input(path))
        case Ranged(low=low, high=high, scale=scale, strays=strays):
            if low == high:
                number = numbers.lifted(low)._replace(scale=scale)
            else:
                number = d.vector(path, low, high, scale)
            loose = d.graph.input(f"{path} strays") if strays else FALSE
            return numbers.settled(number._replace(loose=loose))
        case Wild(scale=scale):
            return d.wild(path, scale)
        case OpaqueCell(sort=sort):
            return d.opaques.fresh(sort, path, standing=True)


def _is_loose(leaf: Leaf) -> bool:
    return isinstance(leaf, Wild) or (isinstance(leaf, Ranged) and leaf.strays)


def _ranged(made: Iterable[tuple[Leaf, Bits]]) -> Iterator[Number]:
    """The numbers of a state that are vectors with a range."""
    for leaf, value in made:
        if isinstance(leaf, Ranged) and isinstance(value, Number) and leaf.low < leaf.high:
            yield value


class _Landing(Struct):
    """The next-state functions: the value of each latch at the end of INIT and of a round."""

    d: BitDomain
    made: dict[str, tuple[Leaf, Bits]]
    lost: list[int]
    names: dict[str, int] = field(default_factory=dict)
    tokens: dict[str, OpaqueChoice] = field(default_factory=dict)
    found: dict[int, int] = field(default_factory=dict)

    def states(
        self, system: System, leaves: Configuration[Leaf], values: Any
    ) -> tuple[dict[int, int], dict[str, OpaqueChoice]]:
        """The next value of each latch, and of each opaque variable."""
        self.found, self.tokens = {}, {}

        def pair(path: str, leaf: Leaf | None, value: Bits | None) -> None:
            if leaf is not None and path in self.made:
                self._land(path, leaf, value)

        def longer(length: Bits, room: int) -> None:
            beyond = self.d.binary(BinaryOp.LT, self.d.const(room, INT), length)
            self.lost.append(literal(beyond))

        pairing = Pairing[Leaf, Bits, None](pair, longer, 0, names_of(system))
        pairing.configuration(leaves, values)
        return self.found, self.tokens

    def _land(self, path: str, leaf: Leaf, value: Bits | None) -> None:
        _, fresh = self.made[path]
        match leaf:
            case Truth():
                self._set(path, literal(fresh), FALSE if value is None else literal(value))
            case OpaqueCell():
                if isinstance(value, OpaqueChoice):
                    self.tokens[path] = value
            case Ranged():
                assert isinstance(fresh, Number)
                self._number(path, leaf, fresh, value)
            case _:
                pass

    def _set(self, name: str, latch: int, value: int) -> None:
        self.names[name] = latch
        self.found[latch] = value

    def _number(self, path: str, leaf: Ranged, fresh: Number, value: Bits | None) -> None:
        g = self.d.graph
        number = self.d.number(leaf.low if value is None else value)
        if value is None:
            number = numbers.lifted(leaf.low)._replace(scale=leaf.scale)
        scale = leaf.scale or 1
        strays = number.loose
        if scale % (number.scale or 1):
            strays = TRUE
            number = numbers.lifted(leaf.low)
        elif number.scale != leaf.scale:
            number = numbers.rescaled(g, number, scale)
        plain = number._replace(loose=FALSE, scale=0)
        low, high = numbers.lifted(leaf.low), numbers.lifted(leaf.high)
        inside = g.both(numbers.at_most(g, low, plain), numbers.at_most(g, plain, high))
        strays = g.either(strays, inside ^ 1)
        if fresh.loose != FALSE:
            self._set(f"{path} strays", fresh.loose, strays)
        size = len(fresh.literals)
        otherwise, kept = numbers.resized(low, size), numbers.resized(plain, size)
        for k, (latch, x, y) in enumerate(zip(fresh.literals, otherwise, kept, strict=True)):
            if latch > 1:
                self._set(f"{path}.{k}", latch, g.choose(strays, x, y))


def _tokens(
    made: dict[str, tuple[Leaf, Bits]],
    first: dict[str, OpaqueChoice],
    then: dict[str, OpaqueChoice],
) -> dict[int, tuple[OpaqueChoice, OpaqueChoice]]:
    """The next value of each standing token, by INIT and by a round; missing ones are unchanged."""
    found = {}
    for path, (leaf, value) in made.items():
        if isinstance(leaf, OpaqueCell) and isinstance(value, OpaqueChoice):
            ((token, _),) = value.parts
            assert isinstance(token, int)
            found[token] = (first.get(path, value), then.get(path, value))
    return found


def _relations(
    d: BitDomain, axioms: Axioms, tokens: dict[int, tuple[OpaqueChoice, OpaqueChoice]]
) -> list[Latch]:
    """The latches for relations between the values of variables. New ones may appear on the way."""
    found: dict[object, Latch] = {}
    while True:
        axioms.close()
        new = [
            (atom, x)
            for atom, x in d.opaques.atoms.get(1, {}).items()
            if atom not in found and d.opaques.is_standing(atom)
        ]
        if not new:
            return list(found.values())
        for atom, x in new:
            relation, arguments = atom
            becomes = []
            for part in (0, 1):
                d.opaques.part = part
                values = [_becomes(a, tokens, part) for a in arguments]
                becomes.append(d.opaques.related(relation, values))
            d.opaques.part = 1
            found[atom] = Latch(d.graph.names[x >> 1], x, becomes[0], becomes[1])


def _becomes(
    argument: Argument, tokens: dict[int, tuple[OpaqueChoice, OpaqueChoice]], part: int
) -> OpaqueChoice:
    """The value of an argument after INIT, or after a round; constants are unchanged."""
    if isinstance(argument, Known) or argument not in tokens:
        return OpaqueChoice("", ((argument, TRUE),))
    return tokens[argument][part]
