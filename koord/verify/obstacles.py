"""Obstacles: why a claim is unknown, and how to change that, in words for people.

Engines say which it was when they leave a claim; a verdict that is *unknown* has them all.
"""

from __future__ import annotations

from typing import TypeAlias, assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine, engine_named
from koord.verify.failures import Failure


class TimeUp(Struct, frozen=True):
    """The obstacle that time is up."""

    engine: Engine


class GaveUp(Struct, frozen=True):
    """The obstacle that an engine's effort is used up."""

    engine: Engine


class NoInvariant(Struct, frozen=True):
    """The obstacle that the search for an invariant (by ``who``) was stopped."""

    engine: Engine
    who: str


class NotInductive(Struct, frozen=True):
    """The obstacle that a step breaks the claim from a configuration that may be unreachable."""

    engine: Engine


class Values(Struct, frozen=True):
    """The obstacle of variables, sensors or functions with more values than an engine tracks."""

    engine: Engine
    names: tuple[str, ...]


class Lengths(Struct, frozen=True):
    """The obstacle that an engine covered short lists and maps only."""

    engine: Engine
    what: tuple[str, ...]


class Beyond(Struct, frozen=True):
    """The obstacle of a construct in the program that an engine does not support."""

    engine: Engine
    what: str


class TooLong(Struct, frozen=True):
    """The obstacle that exact numbers of some variables grow without bound."""

    engine: Engine
    names: tuple[str, ...]


class Failed(Struct, frozen=True):
    """The obstacle that an engine failed."""

    engine: Engine
    what: str


class Interrupted(Struct, frozen=True):
    """The obstacle that the user pressed Ctrl-C."""

    engine: Engine = Engine.NONE


class Unshown(Struct, frozen=True):
    """The obstacle that sensors are not defined between the ends of rounds."""

    what: str
    engine: Engine = Engine.NONE


class Unreplayed(Struct, frozen=True):
    """The obstacle that a candidate violation did not replay: some values are abstracted."""

    engine: Engine


class Elsewhere(Struct, frozen=True):
    """The obstacle that another claim is violated, so that this one gets little time."""

    engine: Engine


class WholeRuns(Struct, frozen=True):
    """The obstacle that the chosen engines do not decide liveness."""

    engine: Engine = Engine.NONE


Obstacle: TypeAlias = (
    TimeUp
    | GaveUp
    | NoInvariant
    | NotInductive
    | Values
    | Lengths
    | Beyond
    | TooLong
    | Failed
    | Interrupted
    | Unshown
    | Unreplayed
    | Elsewhere
    | WholeRuns
)


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


def what(obstacle: Obstacle) -> str:
    """Describe an obstacle, without the engine."""
    match obstacle:
        case TimeUp():
            return "its time is up"
        case GaveUp():
            return "it has done all the work that it may"
        case NoInvariant(who=who):
            return f"{who} has done all the work that it may, and found no invariant"
        case NotInductive():
            return "some step breaks it, perhaps from where no run gets"
        case Values(names=found):
            return f"{', '.join(found)} may have more values than it can follow"
        case Lengths(what=said):
            return f"not covered: {'; '.join(said)}"
        case Beyond(what=said) | Failed(what=said) | Unshown(what=said):
            return said
        case TooLong(names=found):
            said = f" in {', '.join(found)}" if found else ""
            return f"exact numbers{said} grow beyond what can be reckoned with"
        case Interrupted():
            return "it was interrupted"
        case Unreplayed():
            return "what seemed to break it is no run of the program"
        case Elsewhere():
            return "another claim is violated, and this one takes long"
        case WholeRuns():
            return "of runs without end only search and bits know something, for a number of robots"
    assert_never(obstacle)


def cure(obstacle: Obstacle, claim: str) -> str:
    """Describe the changes that would remove an obstacle."""
    match obstacle:
        case TimeUp(engine=Engine.EVERY_N):
            return "more time (--timeout, --property-timeout)"
        case TimeUp():
            return "more time (--timeout, --property-timeout), or fewer robots"
        case GaveUp(engine=engine) | NoInvariant(engine=engine) if engine in _ASKED_ALONE:
            return f"invariants that help, fewer robots, or it alone (--engine {engine.value})"
        case GaveUp(engine=Engine.EVERY_N):
            return "invariants that help"
        case GaveUp() | NoInvariant():
            return "invariants that help, or fewer robots"
        case NotInductive():
            return "invariants that help (--explain shows the step that breaks it)"
        case Values():
            return "bounds: of what starts in any way by `assume`, of sensors by contracts"
        case Lengths():
            return "a bound of the length: `assume len(…) <= …`"
        case Beyond() | Unreplayed() | Failed():
            return "another engine"
        case TooLong():
            return "fewer rounds, or bounds of these numbers"
        case Interrupted():
            return "to let it go on"
        case Unshown():
            return "a model that says what is sensed at each instant, or leave --instants out"
        case Elsewhere():
            return f"mend the other claim, or ask of this one alone (--property {claim!r})"
        case WholeRuns():
            return "leave --engine out, and give --robots a number"
    assert_never(obstacle)


#: Engines that do more where they are asked alone.
_ASKED_ALONE = frozenset({Engine.SPACER, Engine.BITS, Engine.SEARCH})


def lines(obstacles: tuple[Obstacle, ...], claim: str) -> list[str]:
    """One line per obstacle, with the engines that it stops."""
    stopped: dict[tuple[str, str], list[str]] = {}
    for obstacle in obstacles:
        engines = stopped.setdefault((what(obstacle), cure(obstacle, claim)), [])
        if obstacle.engine is not Engine.NONE and obstacle.engine.value not in engines:
            engines.append(obstacle.engine.value)
    return [
        f"{', '.join(engines)}: {said}; what would help: {cured}"
        if engines
        else f"{said}; what would help: {cured}"
        for (said, cured), engines in stopped.items()
    ]
