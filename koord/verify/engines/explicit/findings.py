"""What a search says."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.semantics.recordings import Recording
from koord.verify.engines.explicit.finiteness import NotFinite


class GoalKind(Enum):
    """What can be violated."""

    PROPERTY = "property"
    FAULT = "fault"
    CONTRACT = "contract promise"  #: of a module with a model
    LOST_UPDATE = "lost update"


class SearchGoal(Struct, frozen=True):
    """One thing that can be violated; ``name`` is that of the property, contract or variable."""

    subject: GoalKind
    name: str = ""


class Exhausted(Struct, frozen=True):
    """Every reachable configuration has been looked at.

    ``states`` counts them at the starts of rounds, up to symmetry; none is more than ``depth``
    rounds away.
    """

    states: int
    depth: int


class OutOfBounds(Struct, frozen=True):
    """A limit was reached; everything up to ``depth`` rounds has been looked at.

    None: not even all ways to start have been.
    """

    reason: str
    states: int
    depth: int | None


class Violated(Struct, frozen=True):
    """A claim that does not hold: the run ends in a configuration that shows it.

    No run with fewer rounds shows it.
    """

    claim: SearchGoal
    recording: Recording
    states: int

    @property
    def rounds(self) -> int:
        return len(self.recording.rounds)


class Survey(Struct, frozen=True):
    """All claims that do not hold, each once, and how the search ended."""

    violated: tuple[Violated, ...]
    end: Exhausted | OutOfBounds | NotFinite
