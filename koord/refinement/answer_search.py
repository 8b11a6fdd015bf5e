"""Search for answers that nobody gave, by which what the rules claim holds. [EXTERNAL] [REPLAY]

Functions answer equal questions equally in the whole run. So an answer that was chosen in one round
may be changed for a later one, if all claims that hang on it can be met. What is broken whatever
the answers are is found as such; where the search ends undecided, nobody is accused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from functools import partial
from itertools import islice
from random import Random
from typing import TypeAlias

from msgspec import Struct, field

from koord.refinement.claims import Claim, guessed
from koord.refinement.completion import CompletedInputs, Where, mentioned, with_readings
from koord.refinement.open_answers import PARTIALS, CannotTellError, OpenInputs
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import Answer, Concrete, Reading, RecordedInputs
from koord.semantics.values import identical
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.syntax.types import BoolType, EnumType, Type
from koord.traces.trace import Numbers

#: So often claims are evaluated for one of them before nobody knows whether it can hold.
MOST_TRIES = 20_000

#: So many claims are met together, with one choice of answers.
_MOST_TOGETHER = 200

#: So many answers of a type with many values are drawn, and so many tried at most.
_DRAWS, _MOST_CANDIDATES = 6, 24


class Question(Struct, frozen=True):
    """What a function is asked; of one that answers anew each time, also where in the run."""

    function: str
    arguments: tuple[Concrete, ...]
    asked: tuple[int, Where] | None = None


class Verdict(Enum):
    """Whether a claim can hold."""

    HOLDS = "holds"  #: by the answers chosen
    BROKEN = "broken"  #: whatever the answers are
    UNKNOWN = "unknown"


class Posed(Struct, eq=False):
    """A claim in a round, with the inputs and the answers that were told in it.

    ``made`` are all answers that it asks for beyond these, ``choices`` those that nobody gave.
    """

    claim: Claim
    round: int
    told: Mapping[Where, Answer]
    others: RecordedInputs = field(default_factory=RecordedInputs)
    made: tuple[Answer, ...] = ()
    choices: tuple[Question, ...] = ()


class _Point(Struct):
    """A question on trial: the candidates for its answer, and the present one."""

    candidates: list[Concrete]
    is_finite: bool  #: whether there are no other answers
    at: int = 0

    @property
    def value(self) -> Concrete:
        return self.candidates[self.at]


class _Outcome(Struct, frozen=True):
    holds: bool
    made: tuple[Answer, ...]
    choices: dict[Question, Concrete]


_Find: TypeAlias = Callable[[Question, core.External, int], Concrete]


class _TooManyError(Exception):
    """Raised where a search takes too long."""


class AnswerSearch:
    """The answers of a whole run: those that robots told, and those that are chosen for claims."""

    def __init__(self, system: System, told: Iterable[Answer]) -> None:
        self.system = system
        # What a summary says of every value is taken on trust, as replay does. [REPLAY]
        self.sampled = SampledInputs(Sampler(system, Numbers.DOUBLE, Random(0)), samples=0)
        self.sites = mentioned(system.program)
        self._kinds = {function.name: function.kind for function in system.program.externals}
        self._told: dict[Question, Concrete] = {}
        self._chosen: dict[Question, Concrete] = {}
        self._asking: dict[Question, list[Posed]] = {}
        self._tries = 0
        self._is_endless = False
        for answer in told:
            if answer.function is not None and self._lasts(answer.function):
                self._fix(Question(answer.function, answer.arguments), answer.value)

    # --- questions --------------------------------------------------------------------------------

    def question(
        self, round_: int, where: Where, function: str, arguments: tuple[Concrete, ...]
    ) -> Question:
        """The question under a key in a round."""
        return Question(function, arguments, None if self._lasts(function) else (round_, where))

    def value(self, question: Question) -> Concrete | None:
        """The answer that was told or chosen, if there is one."""
        told = self._told.get(question)
        return self._chosen.get(question) if told is None else told

    def fix(self, question: Question, function: core.External, robot: int) -> Concrete:
        """Choose an answer that has an influence on the run: it stays."""
        value = self._told.get(question)
        if value is None:
            value = self._chosen[question] = self._first(question, function, robot)
            self._fix(question, value)
        return value

    def readings(
        self, configuration: Configuration[Constant], given: tuple[Reading, ...]
    ) -> tuple[Reading, ...]:
        """The readings of a round, with some for sensors that nobody read. Raises KoordError."""
        known = self.sampled.functions
        before = len(known)
        readings = with_readings(self.system, configuration, given, self.sampled)
        for (function, arguments), value in islice(known.items(), before, None):
            self._chosen.setdefault(Question(function, arguments), value)
        return readings

    def is_told(self, phase: Phase, key: Key) -> bool:
        """Return whether a robot tells what is asked under a key, as its program asks it."""
        return phase is not Phase.CHECK and key[0] not in self.sites

    @property
    def choices(self) -> frozenset[Question]:
        """The questions whose answers nobody gave."""
        return frozenset(self._chosen)

    def _lasts(self, function: str) -> bool:
        return self._kinds.get(function) is core.ExternalKind.FUNCTION

    def _fix(self, question: Question, value: Concrete) -> None:
        self._told[question] = value
        self._remember(question, value)

    def _remember(self, question: Question, value: Concrete) -> None:
        if question.asked is None:
            self.sampled.functions[question.function, question.arguments] = value

    # --- claims -----------------------------------------------------------------------------------

    def pose(self, posed: Posed) -> Verdict:
        """Choose answers by which a claim holds, and all earlier ones still do.

        Raises IllegalStepError where a robot should have told an answer.
        """
        first = self._evaluated(posed, self._first)
        if not first.choices:
            posed.made = first.made
            return Verdict.HOLDS if first.holds else Verdict.BROKEN
        verdict, found = Verdict.HOLDS, first.choices
        if not first.holds:
            verdict, searched = self._searched(posed)
            found = found if searched is None else searched
        self._choose(posed, found)
        return verdict

    def _searched(self, posed: Posed) -> tuple[Verdict, dict[Question, Concrete] | None]:
        if self._is_false_by_all(posed):
            return Verdict.BROKEN, None
        self._tries, self._is_endless = MOST_TRIES, False
        try:
            found = self._settled([posed], {}, 0)
        except _TooManyError:
            return Verdict.UNKNOWN, None
        if found is not None:
            return Verdict.HOLDS, found
        return Verdict.UNKNOWN if self._is_endless else Verdict.BROKEN, None

    def _is_false_by_all(self, posed: Posed) -> bool:
        """Return whether a claim is seen to be false without a look at what nobody told."""

        def known(
            phase: Phase,
            robot: int,
            key: Key,
            function: core.External,
            arguments: tuple[Concrete, ...],
        ) -> Concrete | None:
            where = phase, robot, key
            if where in posed.told:
                return posed.told[where].value
            return self._told.get(self.question(posed.round, where, function.name, arguments))

        inputs = OpenInputs(posed.others, self.system.robots, known)
        try:
            return posed.claim.holds(PARTIALS, self.system, inputs) is False
        except (CannotTellError, NotFiniteError):
            return False

    def _evaluated(self, posed: Posed, find: _Find) -> _Outcome:
        """Evaluate a claim with answers that nobody gave."""
        choices: dict[Question, Concrete] = {}
        inputs = self._inputs(posed, find, choices)
        holds = posed.claim.holds(DOUBLES, self.system, inputs) is True
        return _Outcome(holds, tuple(inputs.made), choices)

    def _inputs(
        self, posed: Posed, find: _Find, choices: dict[Question, Concrete]
    ) -> CompletedInputs:
        """The inputs of a claim, which notes the ``choices`` that it asks for."""

        def ask(
            phase: Phase,
            robot: int,
            key: Key,
            function: core.External | None,
            arguments: tuple[Concrete, ...],
        ) -> Concrete | None:
            if function is None or (phase is not Phase.ENV and self.is_told(phase, key)):
                return None
            where = phase, robot, key
            question = self.question(posed.round, where, function.name, arguments)
            told = self._told.get(question)
            if told is not None:
                return told
            choices[question] = find(question, function, robot)
            return choices[question]

        return CompletedInputs(posed.others, posed.told, ask)

    def _choose(self, posed: Posed, found: Mapping[Question, Concrete]) -> None:
        """Let answers be the chosen ones, also in earlier claims that hang on them."""
        hanging = self._hanging(found)
        for question, value in found.items():
            self._chosen[question] = value
            self._remember(question, value)
        for one in (posed, *hanging):
            outcome = self._evaluated(one, self._first)
            one.made, one.choices = outcome.made, tuple(outcome.choices)
            for question, value in outcome.choices.items():
                self._chosen.setdefault(question, value)
                asking = self._asking.setdefault(question, [])
                if one not in asking[-1:]:
                    asking.append(one)

    def _hanging(self, found: Mapping[Question, Concrete]) -> list[Posed]:
        """The earlier claims that ask what has another answer now."""
        changed = [
            question
            for question, value in found.items()
            if question in self._chosen and not identical(self._chosen[question], value)
        ]
        hanging = (one for question in changed for one in self._asking.get(question, ()))
        return list(dict.fromkeys(hanging))

    # --- search -----------------------------------------------------------------------------------

    def _settled(
        self, waiting: list[Posed], values: dict[Question, Concrete], depth: int
    ) -> dict[Question, Concrete] | None:
        """Answers by which all waiting claims hold, and all that hang on what they change."""
        if not waiting:
            return values
        if depth > _MOST_TOGETHER:
            raise _TooManyError
        first, *others = waiting
        for found in self._solutions(first, values):
            every = values | found
            more = [
                one
                for one in self._hanging(found)
                if one not in waiting and not self._still_holds(one, every)
            ]
            settled = self._settled([*others, *more], every, depth + 1)
            if settled is not None:
                return settled
        return None

    def _still_holds(self, posed: Posed, values: Mapping[Question, Concrete]) -> bool:
        """Return whether a claim holds with other answers, and asks the same as before."""
        self._spend()

        def find(question: Question, function: core.External, robot: int) -> Concrete:
            found = values.get(question)
            return self._first(question, function, robot) if found is None else found

        outcome = self._evaluated(posed, find)
        return outcome.holds and tuple(outcome.choices) == posed.choices

    def _solutions(
        self, posed: Posed, values: Mapping[Question, Concrete]
    ) -> Iterator[dict[Question, Concrete]]:
        """Yield the answers by which a claim holds that agree with given ones, one by one."""
        points: dict[Question, _Point] = {}
        find = partial(self._at_point, points, values)
        while True:
            self._spend()
            if self._evaluated(posed, find).holds:
                yield {question: point.value for question, point in points.items()}
            elif not all(point.is_finite for point in points.values()):
                self._guess(posed, points, values)
            while points:
                question, last = points.popitem()
                if last.at + 1 < len(last.candidates):
                    last.at += 1
                    points[question] = last
                    break
                self._is_endless = self._is_endless or not last.is_finite
            if not points:
                return

    def _at_point(
        self,
        points: dict[Question, _Point],
        values: Mapping[Question, Concrete],
        question: Question,
        function: core.External,
        robot: int,
    ) -> Concrete:
        found = values.get(question)
        if found is not None:
            return found
        if question not in points:
            type_ = function.result.type
            candidates = list(self._candidates(question, function, robot))
            points[question] = _Point(candidates, isinstance(type_, BoolType | EnumType))
        return points[question].value

    def _guess(
        self, posed: Posed, points: dict[Question, _Point], values: Mapping[Question, Concrete]
    ) -> None:
        """Add answers that a broken claim suggests to the candidates."""
        find = partial(self._at_point, dict(points), values)
        inputs = self._inputs(posed, find, {})
        for guess in guessed(posed.claim, self.system, inputs):
            for question, point in points.items():
                if point.is_finite or len(point.candidates) >= _MOST_CANDIDATES:
                    continue
                is_it = (question.function, question.arguments) == (guess.function, guess.arguments)
                if is_it and guess.value not in point.candidates:
                    point.candidates.insert(point.at + 1, guess.value)

    def _spend(self) -> None:
        self._tries -= 1
        if self._tries < 0:
            raise _TooManyError

    # --- candidates -------------------------------------------------------------------------------

    def _first(self, question: Question, function: core.External, robot: int) -> Concrete:
        return next(self._candidates(question, function, robot))

    def _candidates(
        self, question: Question, function: core.External, robot: int
    ) -> Iterator[Concrete]:
        """Yield different answers: the chosen one, what the library says, others."""
        seen: list[Concrete] = []
        for value in self._drawn(question, function, robot):
            if not any(identical(value, other) for other in seen):
                seen.append(value)
                yield value

    def _drawn(self, question: Question, function: core.External, robot: int) -> Iterator[Concrete]:
        chosen = self._chosen.get(question)
        if chosen is not None:
            yield chosen
        stand_in = self.sampled.stand_in(function, question.arguments)
        if stand_in is not None:
            yield stand_in
        match function.result.type:
            case BoolType():
                yield from (True, False)
            case EnumType(members=members):
                yield from range(len(members))
            case type_:
                yield from self._samples(question, function, robot, type_)

    def _samples(
        self, question: Question, function: core.External, robot: int, type_: Type
    ) -> Iterator[Concrete]:
        yield from self._sampled(question, function, robot)
        for _ in range(_DRAWS):
            yield self.sampled.sampler.value(type_)

    def _sampled(self, question: Question, function: core.External, robot: int) -> list[Concrete]:
        """An answer that the function's own summary allows, if one is found."""
        known = self.sampled.functions
        before = len(known)
        try:
            return [self.sampled.ask(function, question.arguments, robot, {})]
        except KoordError:
            return []  # it asks others, whose answers may be changed
        finally:
            while len(known) > before:  # nothing is chosen yet
                known.popitem()
