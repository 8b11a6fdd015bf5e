"""A second look at states of machine code, by the road of Python. [T-SNAPSHOT] [SYMMETRY]

Of some of the states that machine code has looked at, chosen by a generator of random numbers with
a fixed seed, Python works out the rounds as well: each state after one has to be among those that
machine code has seen, and what the state shows among what it has found. That says nothing of the
other states, but a mistake that concerns many of them does not stay hidden. What stands for a state
is held against a renaming that is worked out here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice, product
from random import Random
from typing import TYPE_CHECKING

from koord.kernels.terms import NoKernelError
from koord.verify.engines.explicit.joint_transitions import JointTransition
from koord.verify.engines.explicit.states import State

if TYPE_CHECKING:
    from koord.kernels.exploration import Exploration
    from koord.kernels.layout import Layout

#: So many states after others are worked out at first, and one more for so much of the machine
#: code's work.
_AT_FIRST = 500
_WORK_PER_LOOK = 16_384

#: Of one state so many are, and of one batch so many states.
_MOST_AFTER_ONE, _MOST_STATES = 400, 4


class DisagreementError(NoKernelError):
    """Raised where machine code and Python say different things: machine code is not believed."""


class SecondLook:
    """Looks at some states once more. ``looked`` counts the states after them."""

    def __init__(
        self,
        exploration: Exploration,
        layout: Layout,
        idle: frozenset[int],
        numbers: Callable[[State], Sequence[int]],
        joints: Callable[[State], Iterator[JointTransition]],
    ) -> None:
        self._exploration = exploration
        self._layout = layout
        self._idle = idle
        self._numbers = numbers
        self._joints = joints
        self._random = Random(1)
        self.looked = 0

    def due(self, first: int, end: int) -> Iterator[int]:
        """Yield some of the states that a batch has looked at, as far as they are due."""
        for _ in range(min(_MOST_STATES, end - first)):
            if self.looked > _AT_FIRST + self._exploration.work // _WORK_PER_LOOK:
                return
            yield self._random.randrange(first, end)

    def look(self, state: State) -> None:
        """Work out rounds from a state. Raises DisagreementError if one leads to nowhere known."""
        for numbers in islice(self._after(state), _MOST_AFTER_ONE):
            self.looked += 1
            if self._exploration.lookup(self.standing_for(numbers)[0]) < 0:
                raise DisagreementError("machine code misses a state")

    def standing_for(self, numbers: Sequence[int]) -> tuple[list[int], tuple[int, ...]]:
        """What stands for a state, and robots' new numbers. Raises DisagreementError if it cannot.

        That is so for each number of robots: the renaming is told, and need not be looked for.
        """
        kept, names = self._exploration.canonical(numbers)
        symmetry = self._layout.symmetry
        is_renaming = symmetry is None or symmetry.is_renaming(names)
        if not is_renaming or kept != self._layout.renamed(numbers, names):
            raise DisagreementError("machine code takes a state for another one")
        return kept, names

    def _after(self, state: State) -> Iterator[Sequence[int]]:
        """Yield states after rounds from one, as machine code makes them.

        It takes the environment's turns of what stands for the end of the program turns.
        """
        for joint in self._joints(state):
            if not joint.is_whole:
                continue
            entries = [list(enumerate(course.entries)) for course in joint.courses]
            for chosen, end in product(product(*entries), joint.ends):
                robots = joint.stopped(tuple(entry.robot for _, entry in chosen))
                middle = list(self._numbers((*robots, *end.shared)))
                for cell in self._idle:
                    middle[cell] = 0
                _, names = self.standing_for(middle)
                outcomes = [
                    [outcome.robot for outcome in ending.outcomes[k] if outcome.fault is None]
                    for ending, (k, _) in zip(joint.endings, chosen, strict=True)
                ]
                for after in product(*outcomes):
                    numbers = self._numbers((*after, *end.shared))
                    yield self._layout.renamed(numbers, names)
