"""What proofs with explorations have in common: their steps, and what was found."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from koord.api.progress import Listener, Progress
from koord.api.results import Result
from koord.refinement.protocol_proof.steps import Answer, Step
from koord.runtime.exploration.claims import InvariantViolation


class Exploring(Protocol):
    """The result of an exploration."""

    @property
    def states(self) -> int:
        """The number of different states."""
        ...

    @property
    def transitions(self) -> int: ...

    @property
    def depth(self) -> int:
        """The greatest number of steps from the beginning."""
        ...

    @property
    def complete(self) -> bool:
        """True if there are no further states."""
        ...

    @property
    def violation(self) -> InvariantViolation | None:
        """What broke an invariant, if anything did."""
        ...


class Proof(Result, frozen=True):
    """The steps of a proof, and the explorations by what was explored."""

    steps: tuple[Step, ...]
    explored: Mapping[str, Exploring]
    interrupted: bool = False

    @property
    def open(self) -> tuple[Step, ...]:
        """The steps that were not proved."""
        return tuple(step for step in self.steps if step.answer is not Answer.PROVED)

    @property
    def refuted(self) -> tuple[Step, ...]:
        """The steps to which there is a counterexample."""
        return tuple(step for step in self.steps if step.answer is Answer.REFUTED)

    @property
    def violations(self) -> tuple[InvariantViolation, ...]:
        """The violations that explorations found."""
        return tuple(one.violation for one in self.explored.values() if one.violation is not None)

    @property
    def ok(self) -> bool:
        """True if every step was proved, and no exploration found a violation."""
        return not self.open and not self.violations and not self.interrupted


def proved(
    steps: Iterable[Step], tell: Listener, is_cancelled: Callable[[], bool]
) -> tuple[Step, ...]:
    """Go through the steps of a proof, and tell of each."""
    done: list[Step] = []
    for step in steps:
        done.append(step)
        tell(Progress(f"{step.action or 'claims'}: {step.statement}"))
        if is_cancelled():
            break
    return tuple(done)
