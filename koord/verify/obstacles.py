"""Obstacles: why a claim is unknown, and how to change that, in words for people.

Engines say which it was when they leave a claim; a verdict that is *unknown* has them all.
A failure is an exception in an engine, which costs its own answers and no others.
"""

from __future__ import annotations

import re
from typing import ClassVar

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.content import ByContent
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine, engine_named

#: Who looks for what makes verdicts say less than they seem to.
VACUITY = "the search for what never happens"

#: Who makes the claims about what is between the ends of rounds.
SHADOWS = "what is asked between rounds"

#: The last place in koord that a traceback names, also where it was in another process.
_PLACE = r'File "[^"]*?(koord/[^"]+\.py)", line (\d+)'

#: What is said of an error, in characters.
_STORY = 160


class Failure(ByContent, frozen=True):
    """A failure of an engine, or of other work, which gave no answer.

    ``where`` is the place in koord that is to blame; there is none where memory is. ``trace`` is
    how it came there.
    """

    ASIDE: ClassVar[frozenset[str]] = frozenset({"trace"})

    who: str
    what: str
    where: str = ""
    trace: str = ""
    names: tuple[str, ...] = ()  #: of variables whose numbers have grown too long for it

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        return f"{self.who} failed: {self.what}{place}"


def failure_of(who: str, error: Exception) -> Failure:
    """Make the failure of an engine from its exception."""
    import traceback  # which reads Python itself, and is seldom needed

    trace = "".join(traceback.format_exception(error))
    story = " ".join(str(error).split())[:_STORY]
    if isinstance(error, MemoryError) or "out of memory" in story:
        return Failure(who, "out of memory", trace=trace)
    places = re.findall(_PLACE, trace)
    what = f"{type(error).__name__}: {story}" if story else type(error).__name__
    return Failure(who, what, ":".join(places[-1]) if places else "koord", trace)


class Obstacle(Struct, frozen=True):
    """Something in the way of an engine: ``WHAT`` it is, and the ``CURE`` that would remove it."""

    WHAT: ClassVar[str]
    CURE: ClassVar[str]
    engine: Engine

    @property
    def what(self) -> str:
        """The obstacle in words, without the engine."""
        return self.WHAT

    def cure(self, claim: str) -> str:
        """The changes that would remove the obstacle of a claim, in words."""
        return self.CURE


class TimeUp(Obstacle, frozen=True):
    """The obstacle that time is up."""

    WHAT = "its time is up"
    CURE = "more time (--timeout, --property-timeout)"

    def cure(self, claim: str) -> str:
        return self.CURE + ("" if self.engine is Engine.EVERY_N else ", or fewer robots")


class GaveUp(Obstacle, frozen=True):
    """The obstacle that an engine's effort is used up."""

    WHAT = "it has done all the work that it may"
    CURE = "invariants that help"

    def cure(self, claim: str) -> str:
        if self.engine in _ASKED_ALONE:
            return f"{self.CURE}, fewer robots, or it alone (--engine {self.engine.value})"
        return self.CURE + ("" if self.engine is Engine.EVERY_N else ", or fewer robots")


class NoInvariant(GaveUp, frozen=True):
    """The obstacle that the search for an invariant (by ``who``) was stopped."""

    who: str

    @property
    def what(self) -> str:
        return f"{self.who} has done all the work that it may, and found no invariant"


class NotInductive(Obstacle, frozen=True):
    """The obstacle that a step breaks the claim from a configuration that may be unreachable."""

    WHAT = "some step breaks it, perhaps from where no run gets"
    CURE = "invariants that help (--explain shows the step that breaks it)"


class Values(Obstacle, frozen=True):
    """The obstacle of variables, sensors or functions with more values than an engine tracks."""

    CURE = "bounds: of what starts in any way by `assume`, of sensors by contracts"
    names: tuple[str, ...]

    @property
    def what(self) -> str:
        return f"{', '.join(self.names)} may have more values than it can follow"


class Lengths(Obstacle, frozen=True):
    """The obstacle that an engine covered short lists and maps only."""

    CURE = "a bound of the length: `assume len(…) <= …`"
    limits: tuple[str, ...]

    @property
    def what(self) -> str:
        return f"not covered: {'; '.join(self.limits)}"


class Beyond(Obstacle, frozen=True):
    """The obstacle of a construct in the program that an engine does not support."""

    CURE = "another engine"
    reason: str

    @property
    def what(self) -> str:
        return self.reason


class Failed(Beyond, frozen=True):
    """The obstacle that an engine failed."""


class TooLong(Obstacle, frozen=True):
    """The obstacle that exact numbers of some variables grow without bound."""

    CURE = "fewer rounds, or bounds of these numbers"
    names: tuple[str, ...]

    @property
    def what(self) -> str:
        of = f" in {', '.join(self.names)}" if self.names else ""
        return f"exact numbers{of} grow beyond what can be reckoned with"


class Interrupted(Obstacle, frozen=True):
    """The obstacle that the user pressed Ctrl-C."""

    WHAT = "it was interrupted"
    CURE = "to let it go on"
    engine: Engine = Engine.NONE


class Unshown(Beyond, frozen=True):
    """The obstacle that sensors are not defined between the ends of rounds."""

    CURE = "a model that says what is sensed at each instant, or leave --instants out"


class Unreplayed(Obstacle, frozen=True):
    """The obstacle that a candidate violation did not replay: some values are abstracted."""

    WHAT = "what seemed to break it is no run of the program"
    CURE = "another engine"


class Elsewhere(Obstacle, frozen=True):
    """The obstacle that another claim is violated, so that this one gets little time."""

    WHAT = "another claim is violated, and this one takes long"

    def cure(self, claim: str) -> str:
        return f"mend the other claim, or ask of this one alone (--property {claim!r})"


class WholeRuns(Obstacle, frozen=True):
    """The obstacle that the chosen engines do not decide liveness."""

    WHAT = "of runs without end only search and bits know something, for a number of robots"
    CURE = "leave --engine out, and give --robots a number"
    engine: Engine = Engine.NONE


#: Engines that do more where they are asked alone.
_ASKED_ALONE = frozenset({Engine.SPACER, Engine.BITS, Engine.SEARCH})


def gave_up(engine: Engine, deadline: Deadline) -> TimeUp | GaveUp:
    """The obstacle of an engine that stopped early: time, or else its effort."""
    return TimeUp(engine) if replace(deadline, cpu_at=None).is_near() else GaveUp(engine)


def failed_at(failure: Failure) -> TooLong | Failed:
    """The obstacle that a failure stands for."""
    engine = engine_named(failure.who)
    if failure.names:
        return TooLong(engine, failure.names)
    return Failed(engine, str(failure))


def names(obstacle: Obstacle) -> tuple[str, ...]:
    """The variables, sensors and functions that an obstacle is about."""
    return obstacle.names if isinstance(obstacle, Values | TooLong) else ()


def lines(obstacles: tuple[Obstacle, ...], claim: str) -> list[str]:
    """One line per obstacle, with the engines that it stops."""
    stopped: dict[tuple[str, str], list[str]] = {}
    for obstacle in obstacles:
        engines = stopped.setdefault((obstacle.what, obstacle.cure(claim)), [])
        if obstacle.engine is not Engine.NONE and obstacle.engine.value not in engines:
            engines.append(obstacle.engine.value)
    return [
        f"{', '.join(engines)}: {said}; what would help: {cured}"
        if engines
        else f"{said}; what would help: {cured}"
        for (said, cured), engines in stopped.items()
    ]
