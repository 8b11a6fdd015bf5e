"""Proofs of progress for every number of robots: what is claimed of whole runs. [T-PROGRESS]

Measures settle one after the other: each only falls in rounds that change none of those before it.
Robots are ones of whom help cannot be refused for ever while no measure changes. If there always is
such a robot as long as the claim is pending, the claim holds. Each premise is a question about one
round, in which the invariants that are given hold.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.walk import nodes, reached
from koord.verify.claims import Claim
from koord.verify.engines.every_n.progress_parts import Help, Measure, help_of, measures_of
from koord.verify.engines.every_n.progress_questions import RoundQuestions, StateQuestion
from koord.verify.engines.every_n.questions import Means


class ProgressProof(Struct, frozen=True):
    """A proof of progress: the measures in order, and the help.

    ``waits``: what leads to the goal lasts until that is reached. ``locks`` are lock classes that
    the robot that is meant does not enter before, and so does not ask for again and again.
    """

    measures: tuple[Measure, ...]
    help: tuple[Help, ...]
    waits: bool
    locks: tuple[int, ...]


def progress(
    system: System, stated: core.Property, known: Sequence[Claim], means: Means
) -> ProgressProof | str:
    """Prove a claim about whole runs, or say why not. ``known`` holds in every round."""
    try:
        return _Search(system, stated, known, means).proof()
    except NotFiniteError as error:
        return str(error)


class _Search:
    """A search for measures and help, where more and more is known.

    Where that makes questions large, it is first made where nothing is: whatever is shown without
    the invariants is so with them.
    """

    def __init__(
        self, system: System, stated: core.Property, known: Sequence[Claim], means: Means
    ) -> None:
        # What functions promise of all values is seldom of use here, and makes questions hard.
        self.system = replace(system, program=_without_promises(system.program))
        self.stated, self.known, self.means = stated, known, means
        self.measures: list[Measure] = []
        self.help: list[Help] = []
        self.waits = False
        self.locks: list[int] = []
        self.likely = help_of(self.system.program)
        self._may_help: dict[tuple[bool, tuple[int, ...]], bool] = {}

    def proof(self) -> ProgressProof | str:
        """Find measures and help that prove the claim."""
        plain = [claim for claim in self.known if not _asks(claim)]
        attempts: list[tuple[Sequence[Claim], Sequence[int]]] = [(plain, _GENERATIONS)]
        if any(_adds_up(self.system.program, claim) for claim in plain):
            attempts.insert(0, ((), _FIRST))
        if len(plain) < len(self.known):
            attempts.append((self.known, _GENERATIONS))
        for known, all_generations in attempts:
            questions = RoundQuestions(self.system, self.stated, known, self.means)
            found = self._is_proof(questions, all_generations)
            if limits := questions.step.limits:
                return f"not covered: {'; '.join(sorted(set(limits)))}"
            if found:
                return ProgressProof(
                    tuple(self.measures), tuple(self.help), self.waits, tuple(self.locks)
                )
        if not self.measures and all(self._may_help.values()):
            return "no measure settles for every number of robots"
        return "nobody is known to help for every number of robots"

    def _is_proof(self, questions: RoundQuestions, all_generations: Sequence[int]) -> bool:
        """Add measures and help that questions show; whether that is a proof."""
        program = self.system.program
        self.waits = self.waits or questions.waits()
        questions.pend(waits=self.waits)
        if self.stated.each is not None:
            classes = [each.index for each in program.lock_classes if each.index not in self.locks]
            self.locks += [lock for lock in classes if not questions.runs_in_vain(lock)]
            questions.pend(waits=self.waits, locks=self.locks)
        for measure in self.measures:
            questions.keep(measure)
        if not self._somebody_may_help():
            return False
        waiting = [each for each in self.likely if each not in self.help]
        left = [m for m in measures_of(program, self.stated) if m not in self.measures]
        for generations in all_generations:
            questions.step.asking.look_ahead(generations)
            left = self._settled(questions, left)
            found = questions.helping(waiting)
            self.help += found
            waiting = [each for each in waiting if each not in found]
            if found and self._somebody_helps(self.help):
                return True
        return False

    def _somebody_may_help(self) -> bool:
        """Return whether somebody helps in one of the ways that are likely, were none refused.

        That is asked once, as it takes less than to ask which of them are.
        """
        under = self.waits, tuple(self.locks)
        if under not in self._may_help:
            self._may_help[under] = self._somebody_helps(self.likely)
        return self._may_help[under]

    def _somebody_helps(self, ways: Sequence[Help]) -> bool:
        """Return whether somebody helps in one of some ways as long as the claim is pending."""
        question = StateQuestion(self.system, self.stated, self.known, self.means)
        return question.somebody(ways, waits=self.waits, locks=self.locks)

    def _settled(self, questions: RoundQuestions, candidates: Sequence[Measure]) -> list[Measure]:
        """Add measures that settle, one layer after the other; those that may still change."""
        left = questions.changing(candidates)
        while new := questions.changing(questions.settling(left)):
            self.measures += new
            for measure in new:
                questions.keep(measure)
            # What cannot change any more says nothing.
            left = questions.changing([measure for measure in left if measure not in new])
        return left


#: How many generations of names questions are asked with, one after the other.
_GENERATIONS = (1, 2, 3)

#: The same where no invariant is known.
_FIRST = (1,)


def _without_promises(program: core.Program) -> core.Program:
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
