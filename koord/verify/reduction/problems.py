"""Problems that are easier to decide than the one that is asked, and the way back from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from random import Random

from msgspec import Struct, field
from msgspec.structs import replace

from koord.sampling.values import Sampler
from koord.semantics.domain import EXACT, Constant
from koord.semantics.expressions import statement
from koord.semantics.oracle import NoOracle, Oracle
from koord.semantics.recordings import Answer, Opening, Reading, Recording, Round, Start
from koord.semantics.rounds import IllegalStepError
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import Rec, Seq, Table, Value, identical, insert, map_scalars
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.syntax.types import (
    ArrayType,
    FloatType,
    GrowingType,
    IntType,
    ListType,
    MapType,
    OpaqueType,
    RecordType,
    Robots,
    Type,
)
from koord.traces.trace import Numbers
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, claims_of, liveness_of
from koord.verify.ledger import VerificationProblem
from koord.verify.reduction.abstraction import Abstraction, abstracted
from koord.verify.reduction.observers import Observer
from koord.verify.verdicts import Counterexample, NotReplayedError, OnlyOfSliceError

#: Lists of a counterexample are made up no longer than that: nobody could read them.
MOST_ITEMS = 12

Token = tuple[str, str]
"""An opaque value: the name of its sort, and its own."""


class Concretion(Struct):
    """A mapping from the opaque values of one recording to concrete ones, injective if possible.

    A value that the program made of parts is made of their real values. One that an external
    function gave is chosen such that the function's whole summary holds. Others are made up, all
    different. Lists and maps have what observers said of them.
    """

    abstraction: Abstraction
    system: System  #: of the original program
    _made: dict[Token, Answer] = field(default_factory=dict)
    _given: dict[Token, Answer] = field(default_factory=dict)
    _seen: dict[Token, list[Answer]] = field(default_factory=dict)
    _values: dict[Token, Value[Constant]] = field(default_factory=dict)
    _count: int = 0

    def recording(self, abstract: Recording) -> Recording:
        """The recording with every opaque value replaced."""
        for answer in _all_answers(abstract):
            self._note(answer)
        opening = abstract.opening
        return Recording(
            Opening(
                opening.order,
                tuple(self._start(start) for start in opening.starts),
                self._answers(opening.answers),
            ),
            tuple(self._round(round_) for round_ in abstract.rounds),
            abstract.loop,
        )

    def _note(self, answer: Answer) -> None:
        if answer.function is None:
            return
        if answer.function in self.abstraction.observers:
            parameter, token = (
                self._abstract_external(answer.function).parameters[0].type,
                answer.arguments[0],
            )
            assert isinstance(parameter, OpaqueType)
            assert isinstance(token, str)
            self._seen.setdefault((parameter.name, token), []).append(answer)
        result = self._abstract_external(answer.function).result.type
        if isinstance(result, OpaqueType) and isinstance(answer.value, str):
            sources = self._made if answer.function in self.abstraction.made else self._given
            sources.setdefault((result.name, answer.value), answer)

    def _round(self, round_: Round) -> Round:
        readings = tuple(
            replace(reading, value=self._value(reading.value, self._sensor(reading)))
            for reading in round_.readings
        )
        return replace(round_, readings=readings, answers=self._answers(round_.answers))

    def _answers(self, answers: tuple[Answer, ...]) -> tuple[Answer, ...]:
        return tuple(
            self._answer(answer)
            for answer in answers
            if answer.function not in self.abstraction.made
            and answer.function not in self.abstraction.observers
        )

    def _answer(self, answer: Answer) -> Answer:
        if answer.function is None:
            return answer
        external = self._abstract_external(answer.function)
        arguments = tuple(
            self._value(value, parameter.type)
            for value, parameter in zip(answer.arguments, external.parameters, strict=True)
        )
        return replace(
            answer, arguments=arguments, value=self._value(answer.value, external.result.type)
        )

    def _start(self, start: Start) -> Start:
        program = self.abstraction.program
        if start.home is Home.ALLWRITE:
            type_ = program.allwrite[start.slot].variable.type
        elif start.home is Home.ALLREAD:
            whole = program.allread[start.slot].variable.type
            assert isinstance(whole, ArrayType)
            type_ = whole.element
        else:
            assert start.robot is not None
            agent = program.agents[self.system.kinds[start.robot]]
            if start.home is Home.LOCAL:
                type_ = agent.locals[start.slot].variable.type
            else:
                type_ = agent.ports[start.slot].declaration.variable.type
        return replace(start, value=self._value(start.value, type_))

    def _sensor(self, reading: Reading) -> Type:
        agent = self.abstraction.program.agents[self.system.kinds[reading.robot]]
        return agent.ports[reading.slot].declaration.variable.type

    def _abstract_external(self, name: str) -> core.External:
        return self.abstraction.program.external(name)

    # --- values ---------------------------------------------------------------------------------

    def _value(self, value: Value[Constant], type_: Type) -> Value[Constant]:
        return map_scalars(value, type_, self._scalar)

    def _scalar(self, value: Constant, type_: Type) -> Value[Constant]:
        if not isinstance(type_, OpaqueType):
            return value
        assert isinstance(value, str)
        return self._real((type_.name, value))

    def _real(self, token: Token) -> Value[Constant]:
        if token not in self._values:
            # Set first, so that a value made of itself does not go round in circles.
            self._values[token] = self._invented(self.abstraction.hidden[token[0]])
            self._values[token] = self._found(token)
        return self._values[token]

    def _found(self, token: Token) -> Value[Constant]:
        made, given = self._made.get(token), self._given.get(token)
        type_ = self.abstraction.hidden[token[0]]
        if made is not None:
            external = self._abstract_external(made.function or "")
            parts = tuple(
                self._value(value, parameter.type)
                for value, parameter in zip(made.arguments, external.parameters, strict=True)
            )
            if made.function in self.abstraction.merges:
                return _merged(*parts)
            return _of_parts(type_, parts)
        if given is not None and given.function not in self.abstraction.observers:
            return self._answered(given, token, type_)
        return next(self._observed(token, type_, ()))

    def _answered(self, answer: Answer, token: Token, type_: Type) -> Value[Constant]:
        """A value that an external function may have answered, by its whole summary."""
        assert answer.function is not None
        abstract = self._abstract_external(answer.function)
        original = self.system.program.external(answer.function)
        arguments = tuple(
            self._value(value, parameter.type)
            for value, parameter in zip(answer.arguments, abstract.parameters, strict=True)
        )
        candidates = list(self._candidates(token, type_, arguments, original))
        for candidate in candidates:
            if self._meets(original, arguments, candidate):
                return candidate
        return candidates[0]

    def _candidates(
        self,
        token: Token,
        type_: Type,
        arguments: tuple[Value[Constant], ...],
        external: core.External,
    ) -> Iterator[Value[Constant]]:
        """Candidates that summaries usually require: paths that begin and end at arguments."""
        if not isinstance(type_, ListType):
            yield from self._observed(token, type_, ())
            return
        ends = [
            part
            for argument, parameter in zip(arguments, external.parameters, strict=True)
            for part in _parts_of(argument, parameter.type, type_.element)
        ]
        yield from self._observed(token, type_, ends)

    def _observed(
        self, token: Token, type_: Type, ends: Sequence[Value[Constant]]
    ) -> Iterator[Value[Constant]]:
        """Values of a token of which is so what observers said; lists also with these ends."""
        seen = self._seen.get(token, ())
        if isinstance(type_, MapType):
            yield self._observed_map(type_, seen)
        elif isinstance(type_, ListType):
            yield from self._observed_lists(type_, seen, ends)
        else:
            yield self._invented(type_)

    def _observed_lists(
        self, type_: ListType, seen: Sequence[Answer], ends: Sequence[Value[Constant]]
    ) -> Iterator[Value[Constant]]:
        length: int | None = None
        items: dict[int, Value[Constant]] = {}
        for answer in seen:
            observer = self.abstraction.observers[answer.function or ""]
            if observer is Observer.LENGTH:
                assert isinstance(answer.value, int)
                length = answer.value
            else:
                _, index, beyond = answer.arguments
                assert isinstance(index, int)
                assert isinstance(beyond, int)
                if 0 <= index < beyond:
                    # A longer list loses elements in its middle; the replay tells if that matters.
                    near = index < MOST_ITEMS // 2 or beyond <= MOST_ITEMS
                    at = index if near else MOST_ITEMS - (beyond - index)
                    items[at] = self._value(answer.value, self._result(answer))
                    length = beyond

        def made(usual: int, given: Mapping[int, Value[Constant]]) -> Value[Constant]:
            """A list, so long as it is usual if nobody asked; -1 is its last element."""
            count = usual if length is None else min(length, MOST_ITEMS)
            known = {k if k >= 0 else count + k: value for k, value in given.items()} | items
            return Seq(
                count,
                tuple(
                    known[k] if k in known else self._invented(type_.element) for k in range(count)
                ),
            )

        yield made(1, {})
        for first in ends:
            for last in ends:
                yield made(3, {0: first, -1: last})
        for end in ends:
            yield made(2, {-1: end})
            yield made(2, {0: end})
        if length is None:
            yield Seq(0, ())

    def _observed_map(self, type_: MapType, seen: Sequence[Answer]) -> Value[Constant]:
        """The map with the keys that were said to be there, and their values where these were."""
        entries: list[tuple[Value[Constant], Value[Constant]]] = []
        told = [(self.abstraction.observers[a.function or ""], a) for a in seen]
        for _, answer in (one for one in told if one[0] is Observer.HAS and one[1].value is True):
            key = self._value(answer.arguments[1], self._parameter(answer, 1))
            if all(not identical(key, other) for other, _ in entries):
                values = (
                    self._value(at.value, self._result(at))
                    for observer, at in told
                    if observer is Observer.AT and identical(at.arguments[1], answer.arguments[1])
                )
                found = next(values, None)
                entries.append((key, self._invented(type_.value) if found is None else found))
        return Table(len(entries), tuple(entries))

    def _result(self, answer: Answer) -> Type:
        return self._abstract_external(answer.function or "").result.type

    def _parameter(self, answer: Answer, at: int) -> Type:
        return self._abstract_external(answer.function or "").parameters[at].type

    def _meets(
        self,
        external: core.External,
        arguments: tuple[Value[Constant], ...],
        answer: Value[Constant],
    ) -> bool:
        rest = [None] * (external.bound - len(arguments) - 1)
        oracle: Oracle[Constant] = NoOracle()
        m = machine(EXACT, self.system, oracle)
        m.memory.bound = [*(held(EXACT, v) for v in (*arguments, answer)), *rest]
        m.in_summary = True
        try:
            return all(statement(m, promise) is True for promise in external.ensures)
        except AssertionError:
            # A promise that asks other external functions: the replay will tell.
            return True

    def _invented(self, type_: Type) -> Value[Constant]:
        """A fresh value, different from all invented before."""
        self._count += 1
        match type_:
            case FloatType():
                return Fraction(self._count)
            case IntType():
                return self._count
            case RecordType(fields=its_fields):
                return Rec(tuple(self._invented(t) for _, t in its_fields))
            case GrowingType(element=element):
                return Seq(1, (self._invented(element),))
            case ArrayType(element=element, size=size):
                count = self.system.robots if size is Robots.ALL else size
                return Seq(count, tuple(self._invented(element) for _ in range(count)))
            case MapType():
                return Table(0, ())
            case OpaqueType(name=name):
                return self._invented(self.abstraction.hidden[name])
            case _:
                return False


def _of_parts(type_: Type, parts: tuple[Value[Constant], ...]) -> Value[Constant]:
    """A record or list of parts, or a map of keys and values in turn. [E-MAP]"""
    if isinstance(type_, RecordType):
        return Rec(parts)
    if isinstance(type_, ListType):
        return Seq(len(parts), parts)
    return _map_of(zip(parts[::2], parts[1::2], strict=True))


def _merged(old: Value[Constant], new: Value[Constant]) -> Value[Constant]:
    assert isinstance(old, Table)
    assert isinstance(new, Table)
    return _map_of((*old.entries, *new.entries))


def _map_of(
    entries: Iterable[tuple[Value[Constant], Value[Constant]]],
) -> Table[Constant]:
    """The map of some entries, of which with one key the last counts. [E-MAP]"""
    found: Table[Constant] = Table(0, ())
    for key, value in entries:
        found = insert(EXACT, found, key, value)
    return found


def _parts_of(value: Value[Constant], type_: Type, wanted: Type) -> Iterator[Value[Constant]]:
    """The parts of a value that are of the wanted type."""
    if type_ == wanted:
        yield value
    elif isinstance(type_, RecordType) and isinstance(value, Rec):
        for part, (_, part_type) in zip(value.fields, type_.fields, strict=True):
            yield from _parts_of(part, part_type, wanted)


def _all_answers(recording: Recording) -> Iterator[Answer]:
    yield from recording.opening.answers
    for round_ in recording.rounds:
        yield from round_.answers


#: So often what a slice left out is made up at random, after it was tried with the plainest values.
TRIES = 3

Identity = tuple[ClaimKind, str, str]


def identity(claim: Claim) -> Identity:
    """The identity of a claim across slices and abstractions of its program."""
    return claim.kind, claim.name, claim.subject


def plain_problem(system: System, part: System | None = None) -> VerificationProblem:
    """The problem of a system or slice; counterexamples are judged on the whole system."""
    return _problem(system, part or system, None)


def abstract_problem(system: System, part: System | None = None) -> VerificationProblem | None:
    """The problem with merely flowing values made opaque; None if there are none."""
    part = part or system
    abstraction = abstracted(part.program)
    if abstraction is None:
        return None
    problem = _problem(system, part, abstraction)
    return replace(problem, system=replace(part, program=abstraction.program))


def problem_of(system: System, part: System | None = None) -> VerificationProblem:
    """The abstract problem if there is one, else the plain one."""
    return abstract_problem(system, part) or plain_problem(system, part)


def _problem(system: System, part: System, abstraction: Abstraction | None) -> VerificationProblem:
    claims = {identity(c): c for c in (*claims_of(system), *liveness_of(system))}
    return VerificationProblem(
        part, _Judge(system, part, abstraction, claims, _Completing(system)), part
    )


class _Judge(Struct):
    """The judge of recordings of a system's slice, with opaque values if it has an abstraction.

    Data alone, so that it can be sent with questions.
    """

    system: System
    part: System
    abstraction: Abstraction | None
    claims: dict[Identity, Claim]  #: of the system
    completing: _Completing

    def __call__(self, recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        real, meant = recording, self.claims[identity(claim)]
        if self.abstraction is not None:
            real = Concretion(self.abstraction, self.part).recording(recording)
        if self.part is self.system:
            return _judged(self.system, real, meant, phase)
        try:
            return self.completing.judged(real, meant, phase)
        except NotReplayedError as error:
            if meant.kind is not ClaimKind.LIVENESS:
                raise
            _lasso(self.part, real, meant)
            raise OnlyOfSliceError(str(error)) from error


def _judged(
    system: System, recording: Recording, claim: Claim, phase: ClaimPhase
) -> Counterexample:
    """The simplified counterexample of a recording that breaks a claim. Raises NotReplayedError."""
    from koord.verify.witness import replayed, simplified  # who has no violation needs none of it

    if claim.kind is ClaimKind.LIVENESS:
        return _lasso(system, recording, claim)
    replayed(system, recording, claim, phase)
    return replayed(system, simplified(system, recording, claim), claim, phase)


def _lasso(system: System, recording: Recording, claim: Claim) -> Counterexample:
    # Of runs without end few programs claim something, and it takes a while to load.
    from koord.verify.lasso_witness import replayed_lasso

    return replayed_lasso(system, recording, claim)


class _Completing(Struct):
    """The judge of a slice's runs: completes them to runs of the whole system. [T-CONE]"""

    system: System
    never_starts: bool = False  #: as far as that was tried

    def judged(self, recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        """The counterexample of a slice's recording, completed with sampled inputs.

        Where no start was found once, none is looked for again: nearly always assumptions
        contradict each other, and otherwise the whole system is asked all the same.
        """
        from koord.sampling.run_extension import extended

        why = NotReplayedError("no start was found that meets the assumptions")
        starts = False
        for sampler in () if self.never_starts else _samplers(self.system):
            try:
                return _judged(self.system, extended(recording, sampler), claim, phase)
            except NotReplayedError as error:
                why, starts = error, True
            except (KoordError, IllegalStepError) as error:
                starts = starts or not _is_no_start(error)
                why = NotReplayedError(f"what a slice does is not made a run: {error}")
        self.never_starts = not starts
        raise why


def _is_no_start(error: KoordError | IllegalStepError) -> bool:
    return isinstance(error, KoordError) and any(d.code == "K920" for d in error.diagnostics)


def _samplers(system: System) -> Iterator[Sampler]:
    from koord.sampling.run_extension import Plain

    yield Plain(system, Numbers.EXACT, Random(0))
    yield from (_Hasty(system, Numbers.EXACT, Random(seed)) for seed in range(TRIES))


class _Hasty(Sampler):
    """A sampler that tries few starts: if assumptions contradict each other, more do not help."""

    start_tries = 100
