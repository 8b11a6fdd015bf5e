"""Proofs of progress for every number of robots: what is claimed of whole runs. [T-PROGRESS]

Measures settle one after the other: each only falls in rounds that change none of those before it.
Robots are ones of whom help cannot be refused for ever while no measure changes. If there always is
such a robot as long as the claim is pending, the claim holds. Each premise is a question about one
round, in which the invariants that are given hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import INT
from koord.syntax.walk import nodes, reached, renamed
from koord.verify.claims import Claim
from koord.verify.engines.every_n.candidates import binary, negated
from koord.verify.engines.every_n.progress_least import (
    Least,
    outnumbered,
    states_of_numbers,
    who_draws,
)
from koord.verify.engines.every_n.progress_parts import (
    MEANT,
    ROBOT,
    Help,
    Measure,
    help_of,
    lasting_of,
    measures_of,
    own_help,
)
from koord.verify.engines.every_n.progress_questions import RoundQuestions, StateQuestion
from koord.verify.engines.every_n.progress_rings import handed_on, rings_of
from koord.verify.engines.every_n.progress_times import conditional, times_of, waits_of
from koord.verify.engines.every_n.questions import Means

if TYPE_CHECKING:
    from koord.verify.engines.every_n.progress_lemmas import Lemmas


class ProgressProof(Struct, frozen=True):
    """A proof of progress: what settles, in order, and the help.

    ``order`` has measures, and lock classes by their index: the robot that is meant does not enter
    them once what is before has settled, and so does not ask for them again and again. ``lasting``
    follows from what leads to the goal, and lasts until that is reached. It rests on ``lemmas``
    that were found for it, besides what was known. Nothing that the ``unmoved`` ways to help read
    changes once all has settled; ``least`` are those of whom one is the first, as far as that is
    known to be needed.
    """

    order: tuple[Measure | int, ...]
    help: tuple[Help, ...]
    lasting: tuple[core.Expr, ...]
    lemmas: tuple[core.Property, ...] = ()
    unmoved: tuple[Help, ...] = ()
    least: tuple[Least, ...] = ()

    @property
    def locks(self) -> tuple[int, ...]:
        """The lock classes in the order."""
        return tuple(part for part in self.order if isinstance(part, int))


def progress(
    system: System,
    stated: core.Property,
    known: Sequence[Claim],
    means: Means,
    *,
    more: Callable[[], Sequence[Claim]] = tuple,
    infer: bool = False,
) -> ProgressProof | str:
    """Prove a claim about whole runs, or say why not. ``known`` holds in every round.

    Where that is too little it asks for ``more`` that does; asked to ``infer``, it looks for it.
    """
    try:
        search = _Search(system, stated, known, means)
        found = search.proof()
        if found == _NO_HELP and (given := more()):
            found = search.with_more(given)
        if infer and found == _NO_HELP:
            found = search.with_lemmas()
    except NotFiniteError as error:
        return str(error)
    return found


#: Why a claim is open of which lemmas may help.
_NO_HELP = "nobody is known to help for every number of robots"

#: So often lemmas are looked for.
_MOST_LEMMAS = 12


class _Search:
    """A search for measures and help, where more and more is known.

    Where that makes questions large, it is first made where nothing is: whatever is shown without
    the invariants is so with them. The order in which measures and lock classes are found is that
    of [T-PROGRESS].
    """

    def __init__(
        self, system: System, stated: core.Property, known: Sequence[Claim], means: Means
    ) -> None:
        # What functions promise of all values is seldom of use here, and makes questions hard.
        self.whole = system
        self.system = replace(system, program=without_promises(system.program))
        self.stated, self.known, self.means = stated, list(known), means
        self.more: list[Claim] = []  #: what was found before and is known besides
        self.order: list[Measure | int] = []
        self.measures: list[Measure] = []
        self.help: list[Help] = []
        self.unmoved: list[Help] = []
        self.lasting: tuple[core.Expr, ...] = ()
        self.locks: list[int] = []
        program = self.system.program
        self.likely = (*help_of(program), *waits_of(program))
        # What each asks of all others' numbers takes the more instances.
        self.generations = _FIRST if any(outnumbered(program, stated)) else _GENERATIONS
        self._may_help: dict[tuple[core.Expr, ...], bool] = {}
        self._state: StateQuestion | None = None  #: about a configuration in which that is known

    def proof(self) -> ProgressProof | str:
        """Find measures and help that prove the claim."""
        plain = [claim for claim in self.known if not _asks(claim)]
        attempts: list[tuple[Sequence[Claim], Sequence[int]]] = [(plain, self.generations)]
        if any(_adds_up(self.system.program, claim) for claim in plain):
            attempts.insert(0, ((), _FIRST))
        if len(plain) < len(self.known):
            attempts.append((self.known, self.generations))
        for known, all_generations in attempts:
            found = self._found(known, all_generations)
            if found is not None:
                return found
        return _NO_HELP

    def with_more(self, more: Sequence[Claim]) -> ProgressProof | str:
        """Find a proof where more is known, with all that was found without."""
        self.more += more
        self._know([*self.known, *more])
        found = self.proof()
        return _resting_on(self.more, found) if isinstance(found, ProgressProof) else found

    def _know(self, known: Sequence[Claim]) -> None:
        """Suppose that more holds in every round."""
        self.known = list(known)
        self._may_help.clear()
        self._state = None

    def with_lemmas(self) -> ProgressProof | str:
        """Find lemmas against what is in the way, one after the other, and a proof with them."""
        from koord.verify.engines.every_n.progress_lemmas import Lemmas  # seldom needed

        search = Lemmas.of(self.whole, self.known, self.means)
        if search is None:
            return _NO_HELP
        for _ in range(_MOST_LEMMAS):
            if not self._more(search):
                break
            self._know(search.given)
            found = self._found(self.known, self.generations)
            if isinstance(found, ProgressProof):
                return _resting_on([*self.more, *search.found], found)
            if found is not None:
                return found
        return _NO_HELP

    def _more(self, search: Lemmas) -> bool:
        """Find more lemmas: against a configuration in which nobody may help, or for what fails."""
        if self._more_of_numbers(search):
            return True
        if search.naturals(self._differences()):
            return True
        language = search.search.language
        question = StateQuestion(self.system, self.stated, self.known, self.means)
        here = question.where_nobody(language, self.likely, self.lasting, self._classes())
        if here is not None:
            return search.against(here)
        questions = RoundQuestions(self.system, self.stated, self.known, self.means)
        self._suppose(questions)
        questions.step.asking.look_ahead(2)
        waiting = [each for each in self.likely if each not in self.help]
        here = questions.against(language, waiting)
        return here is not None and search.against(here)

    def _more_of_numbers(self, search: Lemmas) -> bool:
        """Find lemmas by which who outnumbers the robot that is meant does so until the goal."""
        open_ = self._open_numbers()
        if not open_:
            return False
        drawn = search.together(states_of_numbers(self.system.program))
        return any(search.by_themselves(self._behind(measure)) for measure in open_) or drawn

    def _open_numbers(self) -> list[Measure]:
        """That robots do not outnumber the one that is meant, as far as that may not settle."""
        found = outnumbered(self.system.program, self.stated)
        return [
            measure
            for measure in found
            if measure not in self.measures and isinstance(measure.term.said, core.Unary)
        ]

    def _behind(self, measure: Measure) -> list[tuple[core.Expr, int]]:
        """That who draws another number, or gives one up, does not outnumber who is meant."""
        each = self.stated.each
        assert each is not None
        pending = self._pending(each, MEANT)
        found = []
        for guard in who_draws(self.system.program, measure):
            open_ = binary(BinaryOp.AND, pending, guard)
            body = binary(BinaryOp.IMPLIES, open_, measure.term.said)
            said: core.Expr = body
            for robot in (ROBOT, MEANT):
                said = core.Quantified(core.QuantifierKind.FORALL, robot, core.RobotRange(), said)
            found.append((said, measure.term.bound))
        return found

    def _pending(self, each: core.Each, robot: core.Variable) -> core.Expr:
        """What holds of a robot while the claim is pending."""
        # What lasts says more, and most often that the goal is not reached.
        not_reached = negated(self.stated.condition)
        pending = self.lasting[-1] if self.lasting else not_reached
        said: core.Expr = renamed(pending, each.variable, robot)
        return said

    def _differences(self) -> list[tuple[core.Each, core.Expr, core.Binary]]:
        """The differences of the robot that is meant, and what holds while the claim is pending."""
        each = self.stated.each
        if each is None:
            return []
        me = replace(each.variable, name=ROBOT.name)
        pending, who = self._pending(each, me), replace(each, variable=me)
        return [
            (who, pending, renamed(measure.term.said, MEANT, me))
            for measure in self._measures()
            if isinstance(measure.term.said, core.Binary)
            and measure.term.said.op is BinaryOp.SUB
            and measure.each is None
            and measure.term.said.type == INT
        ]

    def _found(
        self, known: Sequence[Claim], all_generations: Sequence[int]
    ) -> ProgressProof | str | None:
        """A proof with some invariants, or why there is none with any; None if they are too few."""
        questions = RoundQuestions(self.system, self.stated, known, self.means)
        is_proof = self._is_proof(questions, known, all_generations)
        if limits := questions.step.limits:
            return f"not covered: {'; '.join(sorted(set(limits)))}"
        if not is_proof:
            return None
        unmoved = tuple(self.unmoved)
        return ProgressProof(tuple(self.order), tuple(self.help), self.lasting, unmoved=unmoved)

    def _is_proof(
        self, questions: RoundQuestions, known: Sequence[Claim], all_generations: Sequence[int]
    ) -> bool:
        """Add measures, locks and help that questions show; whether that is a proof."""
        self.lasting = self.lasting or self._lasting(questions)
        if not self._somebody_may_help():
            return False
        self._go_round(known)
        self._suppose(questions)
        self._grant(questions)
        waiting = [each for each in self.likely if each not in self.help]
        left = self._measures()
        for generations in all_generations:
            questions.step.asking.look_ahead(generations)
            left = self._settled(questions, left)
            while self._grant(questions):
                left = self._settled(questions, left)
            found = questions.helping(waiting)
            waiting = [each for each in waiting if each not in found]
            mine = [x for x in own_help(self.stated, waiting) if x not in self.help]
            found += questions.helping(mine)
            unmoved = questions.helping_unmoved([each for each in waiting if each not in found])
            waiting = [each for each in waiting if each not in unmoved]
            found += unmoved
            self.unmoved += unmoved
            self.help += found
            if found and self._is_enough():
                return True
        return False

    def _go_round(self, known: Sequence[Claim]) -> None:
        """Add where around the ring something is that robots hand on, as far as that settles.

        Each is asked about by itself: that somebody is there takes many instances.
        """
        for steps in rings_of(self.system.program, self.stated):
            if any(measure in self.measures for measure in steps):
                continue
            for number, measure in enumerate(steps):
                questions = RoundQuestions(self.system, self.stated, known, self.means)
                self._suppose(questions)
                for before in steps[:number]:
                    questions.keep(before)
                questions.step.asking.look_ahead(_AROUND)
                if not questions.settling([measure]):
                    break
            else:
                self.measures += steps
                self.order += steps

    def _suppose(self, questions: RoundQuestions) -> None:
        """Suppose what is known of late rounds."""
        questions.pend(self.lasting)
        for measure in self.measures:
            questions.keep(measure)
        for lock in self.locks:
            questions.ask_no_more(lock)

    def _measures(self) -> list[Measure]:
        """The measures that are not known to settle."""
        program = self.system.program
        plain = (*measures_of(program, self.stated), *handed_on(program))
        behind = outnumbered(program, self.stated)
        likely = (*plain, *behind, *times_of(program), *conditional(program))
        return [measure for measure in likely if measure not in self.measures]

    def _lasting(self, questions: RoundQuestions) -> tuple[core.Expr, ...]:
        """What follows from the trigger and holds until the goal does, the simplest there is."""
        for likely in lasting_of(self.system.program, self.stated):
            if found := questions.lasting(likely):
                return tuple(found)
        return ()

    def _classes(self) -> list[int]:
        """The lock classes that the robot that is meant may ask for."""
        if self.stated.each is None:
            return []
        return [each.index for each in self.system.program.lock_classes]

    def _grant(self, questions: RoundQuestions) -> bool:
        """Add lock classes that are granted for the sake of the goal; whether there are any."""
        before = len(self.locks)
        for lock in self._classes():
            if lock not in self.locks and not questions.runs_in_vain(lock):
                self.locks.append(lock)
                self.order.append(lock)
                questions.ask_no_more(lock)
        return len(self.locks) > before

    def _somebody_may_help(self) -> bool:
        """Return whether somebody helps in one of the ways that are likely, were none refused.

        That is asked once, as it takes less than to ask which of them are.
        """
        if self.lasting not in self._may_help:
            self._may_help[self.lasting] = self._somebody_helps(self.likely, self._classes())
        return self._may_help[self.lasting]

    def _is_enough(self) -> bool:
        """Return whether somebody helps in one of the ways that are not refused.

        If these are all that are likely, it is known that somebody does.
        """
        if set(self.help) >= set(self.likely) and set(self.locks) >= set(self._classes()):
            return self._somebody_may_help()
        return self._somebody_helps(self.help, self.locks)

    def _somebody_helps(self, ways: Sequence[Help], locks: Sequence[int]) -> bool:
        """Return whether somebody helps in one of some ways as long as the claim is pending."""
        if self._state is None or not self._state.is_new:
            self._state = StateQuestion(self.system, self.stated, self.known, self.means)
        return self._state.somebody(ways, self.lasting, locks)

    def _settled(self, questions: RoundQuestions, candidates: Sequence[Measure]) -> list[Measure]:
        """Add measures that settle, one layer after the other; those that may still change."""
        left, is_sifted = list(candidates), False
        # Of those that settle it is asked first whether they change, as they are few.
        while new := questions.changing(questions.settling(left)):
            self.measures += new
            self.order += new
            for measure in new:
                questions.keep(measure)
            # What cannot change any more says nothing.
            left = questions.changing([measure for measure in left if measure not in new])
            is_sifted = True
        return left if is_sifted else questions.changing(left)


#: How many generations of names questions are asked with, one after the other.
_GENERATIONS = (1, 2, 3)

#: The same where somebody hands something on: who has it then is a name of the second.
_AROUND = 2

#: The same where no invariant is known.
_FIRST = (1,)


def _resting_on(lemmas: Sequence[Claim], proof: ProgressProof) -> ProgressProof:
    stated = (claim.stated for claim in lemmas)
    return replace(proof, lemmas=tuple(x for x in stated if x is not None))


def without_promises(program: core.Program) -> core.Program:
    """The program whose functions may be any: whatever is shown of it holds of the program."""
    free = tuple(
        replace(e, ensures=()) if e.kind is core.ExternalKind.FUNCTION else e
        for e in program.externals
    )
    return replace(program, externals=free)


def _adds_up(program: core.Program, claim: Claim) -> bool:
    """Return whether a claim counts or adds up something, in a loop."""
    below = reached(program, claim.stated)
    return any(isinstance(node, core.ForRange | core.ForEach) for node in below)


def _asks(claim: Claim) -> bool:
    """Return whether a claim speaks of an external function."""
    return any(isinstance(node, core.ExternalCall) for node in nodes(claim.stated))
