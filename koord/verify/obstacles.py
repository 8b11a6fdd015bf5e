"""What stands in the way of a verdict, and what would have to change. Said in words here alone.

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
    """The time is up."""

    engine: Engine


class GaveUp(Struct, frozen=True):
    """An engine has done all the work that it may."""

    engine: Engine


class NoInvariant(Struct, frozen=True):
    """Who looks for an invariant was stopped before it had found one; ``who`` that is."""

    engine: Engine
    who: str


class NotInductive(Struct, frozen=True):
    """A step breaks the claim from a configuration that perhaps no run reaches."""

    engine: Engine


class Values(Struct, frozen=True):
    """Variables, sensors or functions that may have more values than an engine can follow."""

    engine: Engine
    names: tuple[str, ...]


class Lengths(Struct, frozen=True):
    """Lists and maps of which an engine looked at short ones only, in its words."""

    engine: Engine
    what: tuple[str, ...]


class Beyond(Struct, frozen=True):
    """Something in the program of which an engine knows nothing."""

    engine: Engine
    what: str


class TooLong(Struct, frozen=True):
    """Exact numbers of some variables grow without end."""

    engine: Engine
    names: tuple[str, ...]


class Failed(Struct, frozen=True):
    """An engine ran into something, and gave no answer."""

    engine: Engine
    what: str


class Interrupted(Struct, frozen=True):
    """Somebody pressed Ctrl-C."""

    engine: Engine = Engine.NONE


class Unshown(Struct, frozen=True):
    """Nobody knows what is sensed between the ends of rounds."""

    what: str
    engine: Engine = Engine.NONE


class Unreplayed(Struct, frozen=True):
    """What an engine took for a violation is none: it knows too little of some values."""

    engine: Engine


class Elsewhere(Struct, frozen=True):
    """Another claim is violated, so that nobody waits long for this one."""

    engine: Engine


class WholeRuns(Struct, frozen=True):
    """The engines that were asked know nothing of runs without end."""

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
    """Why an engine stopped that was not done: more time helps only where that was limited."""
    return TimeUp(engine) if replace(deadline, cpu_at=None).is_near() else GaveUp(engine)


def failed_at(failure: Failure) -> TooLong | Failed:
    """What stands in the way where somebody failed."""
    engine = engine_named(failure.who)
    if failure.names:
        return TooLong(engine, failure.names)
    return Failed(engine, str(failure))


def names(obstacle: Obstacle) -> tuple[str, ...]:
    """The variables, sensors and functions that an obstacle is about."""
    return obstacle.names if isinstance(obstacle, Values | TooLong) else ()


def what(obstacle: Obstacle) -> str:
    """What stands in the way, in words, without the engine."""
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
    """What would have to change."""
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
    """One line for each thing that stands in the way, with the engines that it stops."""
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
