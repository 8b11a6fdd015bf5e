"""Axioms of opaque values: summaries instantiated for the tokens that occur.

An axiom is a statement about atoms over variables. It is required of tokens where all of its atoms
but one were asked about (the one may be of its own function only, and of no computed token), and
where two tokens may be equal, what is known of the one is known of the other. To leave out
instances is sound: it allows more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, cast

from msgspec import Struct, field

from koord.semantics.domain import conjunction
from koord.semantics.expressions import statement
from koord.semantics.oracle import Key
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import OpaqueType, Type
from koord.verify.engines.bits.cells import BitUnknowns
from koord.verify.engines.bits.domain import BitDomain, Bits, literal
from koord.verify.engines.bits.graph import FALSE, TRUE
from koord.verify.engines.bits.opaque import EQUALS, Argument, Atom, Known, OpaqueChoice

#: The part of what stands for variables of axioms.
PATTERNS = -1

Binding = dict[int, Argument]


class Axiom(Struct, frozen=True):
    """An axiom: a formula over atoms of variables, each with its literal."""

    function: str
    formula: int
    atoms: tuple[tuple[Atom, int], ...]
    variables: frozenset[int]


class Axioms(Struct):
    """The axioms of a system, and the instances that were required so far."""

    system: System
    d: BitDomain
    _axioms: list[Axiom] = field(default_factory=list)
    _required: dict[int, list[int]] = field(default_factory=lambda: {0: [], 1: []})
    _done: set[object] = field(default_factory=set)
    _constructors: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        externals = self.system.program.externals
        self._constructors = frozenset(e.name for e in externals if e.constructs)
        for external in self.system.program.externals:
            self._axioms += _axioms_of(self.system, self.d, external)

    def of(self, part: int) -> list[int]:
        """The instances that were required for the tokens of a part."""
        return self._required[part]

    def close(self) -> None:
        """Require all instances of the axioms that match by now."""
        for part in (0, 1):
            self.d.opaques.part = part
            atoms = self.d.opaques.atoms.setdefault(part, {})
            count = -1
            while count != len(atoms):
                count = len(atoms)
                known = _Known(self.d, atoms)
                for number, axiom in enumerate(self._axioms):
                    for binding in known.matches(axiom):
                        self._require(number, axiom, binding, part)
            self._constructions(part, atoms)
            self._congruences(part, atoms)
        self.d.opaques.part = 1

    def _require(self, number: int, axiom: Axiom, binding: Binding, part: int) -> None:
        key = (part, number, tuple(sorted(binding.items(), key=str)))
        if key in self._done:
            return
        self._done.add(key)
        opaques = self.d.opaques
        meaning = {}
        for (relation, arguments), literal_ in axiom.atoms:
            actual = tuple(_instance(self.d, a, binding) for a in arguments)
            meaning[literal_ >> 1] = opaques.atom(relation, actual)
        required = self.d.graph.substituted(axiom.formula, meaning)
        if required != TRUE:
            self._required[part].append(required)

    def _constructions(self, part: int, atoms: dict[Atom, int]) -> None:
        """Require that lists and records are equal if their lengths and parts are."""
        opaques, g = self.d.opaques, self.d.graph
        for (relation, arguments), same in list(atoms.items()):
            if relation != EQUALS or (part, same) in self._done:
                continue
            one, other = (opaques.tokens[a] for a in arguments if not isinstance(a, Known))
            if not self._constructors.issuperset((one.function, other.function)):
                continue
            self._done.add((part, same))
            if len(one.arguments) != len(other.arguments):
                self._required[part].append(same ^ 1)
            elif one.function == other.function:
                pairs = zip(one.arguments, other.arguments, strict=True)
                alike = g.all_of(self._alike(a, b) for a, b in pairs)
                self._required[part].append(g.differ(same, alike) ^ 1)

    def _alike(self, one: Argument, other: Argument) -> int:
        if isinstance(one, Known) or isinstance(other, Known):
            return TRUE if one == other else FALSE
        return self.d.opaques.atom(EQUALS, (one, other))

    def _congruences(self, part: int, atoms: dict[Atom, int]) -> None:
        """Require congruence: equal tokens agree in every atom asked about both."""
        g = self.d.graph
        by_argument: dict[Argument, list[tuple[Atom, int]]] = {}
        for atom, x in list(atoms.items()):
            for argument in set(atom[1]):
                by_argument.setdefault(argument, []).append((atom, x))
        for (relation, arguments), same in list(atoms.items()):
            if relation != EQUALS:
                continue
            one, other = arguments
            for atom, x in by_argument.get(one, []):
                for k, argument in enumerate(atom[1]):
                    if argument != one:
                        continue
                    moved = (*atom[1][:k], other, *atom[1][k + 1 :])
                    y = self._there(atoms, atom[0], moved)
                    key = (part, same, x, y)
                    if y is not None and x != same and key not in self._done:
                        self._done.add(key)
                        alike = g.differ(x, y) ^ 1
                        self._required[part].append(g.either(same ^ 1, alike))

    def _there(
        self, atoms: dict[Atom, int], relation: str, arguments: tuple[Argument, ...]
    ) -> int | None:
        if relation == EQUALS:
            if arguments[0] == arguments[1]:
                return TRUE
            arguments = tuple(sorted(arguments, key=str))
        return atoms.get((relation, arguments))


def _instance(d: BitDomain, argument: Argument, binding: Binding) -> Argument:
    """Instantiate an argument of an axiom."""
    if isinstance(argument, Known) or argument in binding:
        return argument if isinstance(argument, Known) else binding[argument]
    token = d.opaques.tokens[argument]
    arguments = tuple(_instance(d, a, binding) for a in token.arguments)
    return d.opaques.term(token.function, arguments, token.sort)


# --- matching -------------------------------------------------------------------------------------


class Made(NamedTuple):
    """A pattern: any token that is the result of a function."""

    function: str


class _Known(Struct):
    """The atoms asked about so far, by relation and argument."""

    d: BitDomain
    atoms: dict[Atom, int]
    _index: dict[object, list[tuple[Argument, ...]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for relation, arguments in self.atoms:
            self._index.setdefault(relation, []).append(arguments)
            for place, argument in enumerate(arguments):
                self._index.setdefault((relation, place, argument), []).append(arguments)
                if isinstance(argument, int) and (f := self.d.opaques.tokens[argument].function):
                    self._index.setdefault((relation, place, Made(f)), []).append(arguments)

    def matches(self, axiom: Axiom) -> Iterator[Binding]:
        """Yield bindings of all variables for which all atoms but one exist."""
        patterns = [atom for atom, _ in axiom.atoms]
        skippable = [None, *(p for p in patterns if self._may_be_new(axiom, p))]
        for skipped in skippable:
            wanted = [p for p in patterns if p is not skipped]
            for binding in self._extended({}, wanted):
                if axiom.variables <= binding.keys():
                    yield binding

    def _may_be_new(self, axiom: Axiom, pattern: Atom) -> bool:
        tokens = self.d.opaques.tokens
        plain = all(isinstance(a, Known) or not tokens[a].function for a in pattern[1])
        return plain and pattern[0] == axiom.function

    def _extended(self, binding: Binding, wanted: list[Atom]) -> Iterator[Binding]:
        if not wanted:
            yield binding
            return
        # The pattern with the fewest candidates first.
        best, candidates = wanted[0], self._candidates(wanted[0], binding)
        for pattern in wanted[1:]:
            others = self._candidates(pattern, binding)
            if len(others) < len(candidates):
                best, candidates = pattern, others
        rest = [p for p in wanted if p is not best]
        for arguments in list(candidates):
            extended = self._unified(best[1], arguments, binding)
            if extended is not None:
                yield from self._extended(extended, rest)

    def _candidates(self, pattern: Atom, binding: Binding) -> list[tuple[Argument, ...]]:
        relation, arguments = pattern
        best = self._index.get(relation, [])
        for place, argument in enumerate(arguments):
            bound = self._bound(argument, binding)
            if bound is not None:
                found = self._index.get((relation, place, bound), [])
                best = found if len(found) < len(best) else best
        return best

    def _bound(self, argument: Argument, binding: Binding) -> object:
        """The value that an argument of a pattern must have under a binding; None if not known."""
        if isinstance(argument, Known):
            return argument
        token = self.d.opaques.tokens[argument]
        if not token.function:
            return binding.get(argument)
        inner = tuple(self._bound(a, binding) for a in token.arguments)
        if any(not isinstance(a, int | Known) for a in inner):
            return Made(token.function)
        return self.d.opaques.found(token.function, cast("tuple[Argument, ...]", inner))

    def _unified(
        self, pattern: tuple[Argument, ...], actual: tuple[Argument, ...], binding: Binding
    ) -> Binding | None:
        tokens = self.d.opaques.tokens
        found = dict(binding)
        for wanted, given in zip(pattern, actual, strict=True):
            if isinstance(wanted, Known):
                if wanted != given:
                    return None
            elif wanted in found:
                if found[wanted] != given:
                    return None
            elif not tokens[wanted].function:
                found[wanted] = given
            else:
                if isinstance(given, Known) or tokens[given].function != tokens[wanted].function:
                    return None
                deeper = self._unified(tokens[wanted].arguments, tokens[given].arguments, found)
                if deeper is None:
                    return None
                found = deeper
        return found


# --- reading summaries ----------------------------------------------------------------------------


def _axioms_of(system: System, d: BitDomain, external: core.External) -> Iterator[Axiom]:
    unknowns = BitUnknowns(cast(Any, d), system.program, system.robots)
    if not unknowns.vouches_for(external):
        return
    for promise in external.ensures:
        axiom = _read(system, d, unknowns, external, promise)
        if axiom is not None:
            yield axiom


def _read(
    system: System,
    d: BitDomain,
    unknowns: BitUnknowns,
    external: core.External,
    promise: core.Expr,
) -> Axiom | None:
    """Read a summary as an axiom; None where it is about more than opaque values."""
    d.opaques.part = PATTERNS
    before = dict(d.opaques.atoms.setdefault(PATTERNS, {}))
    d.opaques.atoms[PATTERNS] = {}
    variables: list[OpaqueChoice] = []

    def variable(type_: Type) -> OpaqueChoice | None:
        if not isinstance(type_, OpaqueType):
            return None
        variables.append(d.opaques.fresh(type_.name, "any"))
        return variables[-1]

    arguments = [variable(parameter.type) for parameter in external.parameters]
    if None in arguments:
        return None
    answer = unknowns.function(external, cast(Any, tuple(arguments)), external.name)
    m: Any = machine(cast(Any, d), system, cast(Any, _Promised(unknowns)))
    m.in_summary = True
    bound = [held(cast(Any, d), value) for value in (*arguments, answer)]
    m.memory.bound = [*bound, *[None] * (external.bound - len(bound))]
    while isinstance(promise, core.Quantified) and isinstance(promise.domain, core.AllValues):
        value = variable(promise.domain.type)
        if value is None:
            return None
        m.memory.bound[promise.variable.slot] = held(cast(Any, d), cast(Any, value))
        promise = promise.body
    met = conjunction(cast(Any, d), [statement(m, e) for e in external.requires])
    holds = literal(d.binary(BinaryOp.IMPLIES, cast(Bits, met), statement(m, promise)))
    atoms = d.opaques.atoms[PATTERNS]
    d.opaques.atoms[PATTERNS] = before
    inputs = {node for node in d.graph.cone([holds]) if d.graph.is_input(node)}
    used = tuple((atom, x) for atom, x in atoms.items() if x >> 1 in inputs)
    if inputs != {x >> 1 for _, x in used}:
        return None
    tokens = frozenset(t for v in variables for t, _ in v.parts if isinstance(t, int))
    return Axiom(external.name, holds, used, tokens)


class _Promised(Struct):
    """The oracle while a summary is read as an axiom."""

    unknowns: BitUnknowns

    def choose(self, key: Key, low: Any, high: Any, type_: Type) -> Any:
        raise AssertionError("summaries do not choose")

    def external(self, function: core.External, key: Key, arguments: tuple[Any, ...]) -> Any:
        return self.unknowns.function(function, arguments, function.name)

    def every(self, type_: Type, body: Callable[[Any], Any]) -> Any:
        return self.unknowns.d.for_all((), body(self.unknowns.value("every", type_)))

    def vouches_for(self, function: core.External) -> bool:
        return True
