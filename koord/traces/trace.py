"""Traces: recorded runs, each together with its program's texts and its configurations. [TRACE]

A trace holds the texts, the settings and the recording, so that it can be replayed on its own, and
the configurations that the run went through, so that the replay has something to compare with.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from fractions import Fraction
from typing import TYPE_CHECKING

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Written
from koord.semantics.domain import DOUBLES, EXACT, Constant, Domain
from koord.semantics.recordings import Recording, Step, execute
from koord.syntax import core
from koord.syntax.problem import Problem
from koord.syntax.source import Source
from koord.syntax.system import System

if TYPE_CHECKING:
    from koord.syntax.elaboration.settings import ParamValue

#: The round of what INIT does: it belongs to none.
BEFORE_ROUNDS = -1


class Numbers(Enum):
    """The number domain that a run was made in. [DOMAIN]"""

    EXACT = "exact"
    DOUBLE = "double"

    @property
    def domain(self) -> Domain[Constant]:
        return EXACT if self is Numbers.EXACT else DOUBLES


class Sources(Struct, frozen=True):
    """The texts that a program was read from, and the values of its params."""

    program: Source
    properties: tuple[Source, ...] = ()
    params: tuple[tuple[str, ParamValue], ...] = ()
    tasks: core.Places | None = None

    @property
    def texts(self) -> tuple[Source, ...]:
        return (self.program, *self.properties)


def digest(source: Source) -> str:
    """The SHA-256 digest of a text, in hexadecimal."""
    from hashlib import sha256  # who verifies makes no digests

    return sha256(source.text.encode("utf-8", errors="surrogatepass")).hexdigest()


class ViolationKind(Enum):
    """The kinds of violation. (A fault is no violation but a configuration.)"""

    PROPERTY = "property"
    CONTRACT = "contract"  #: of a module with a model
    LOST_UPDATE = "lost update"


class Violation(Struct, frozen=True):
    """A violation at the end of a trace: a property, contract or variable, and the robot.

    ``name`` is that of the property, the contract or the variable. ``robot`` is the one whose turn
    broke it, None if that was INIT or the environment's turn (for a contract: whose model it is).
    """

    kind: ViolationKind
    name: str
    round: int
    robot: int | None


class Emitted(Struct, frozen=True):
    """Values written to a stream in a step; ``robot`` is None for INIT."""

    round: int
    robot: int | None
    written: Written[Constant]


class Trace(Struct, frozen=True):
    """A trace: a recorded run of a system, with its configurations and output.

    ``configurations[k]`` is the one before round k; the last one is where the run ended, be it
    between two rounds or, after a fault or a violation, inside one. So there is one more of them
    than rounds in the recording.

    ``slack`` is by how much floats may be off in what the program claims, for vehicles that made
    the run keep no claim to the letter. Of a trace that is ``cut_off`` the file ends in the middle:
    what the run did after these rounds is not known.

    ``later`` are the parts of a run whose program was changed: each a trace of its own program,
    whose recording goes on from where the part before it ended, and counts rounds from there.
    [RELOAD]
    """

    sources: Sources
    system: System
    numbers: Numbers
    recording: Recording
    configurations: tuple[Configuration[Constant], ...]
    outputs: tuple[Emitted, ...] = ()
    violation: Violation | None = None
    slack: Fraction = Fraction(0)
    cut_off: bool = False
    later: tuple[Trace, ...] = ()

    @property
    def parts(self) -> tuple[Trace, ...]:
        """The trace of each program that the run had, in order; mostly there is one."""
        return (replace(self, later=()), *self.later) if self.later else (self,)

    @property
    def problem(self) -> Problem:
        """The program, kinds of robot and period that this is a run of."""
        names = tuple(source.name for source in self.sources.texts)
        return Problem(names, self.system.program, self.system.kinds, self.system.delta_s)


class Tracer(Struct):
    """A collector of a run's steps, from which the trace is made."""

    configurations: list[Configuration[Constant]] = field(default_factory=list)
    outputs: list[Emitted] = field(default_factory=list)
    _open: bool = False  #: whether the last configuration lies inside a round

    def add(self, step: Step) -> None:
        """Add the next step of the run."""
        if self._open:
            self.configurations.pop()
        self.configurations.append(step.configuration)
        self._open = not step.is_at_round
        self.outputs += emitted(step)

    def add_round(
        self,
        number: int,
        after: Configuration[Constant],
        written: Iterable[tuple[int, Written[Constant]]],
    ) -> None:
        """Add a whole round: the configuration after it, and what its robots wrote."""
        assert not self._open
        self.configurations.append(after)
        self.outputs += [Emitted(number, robot, one) for robot, one in written]

    def trace(
        self,
        sources: Sources,
        system: System,
        numbers: Numbers,
        recording: Recording,
        violation: Violation | None = None,
    ) -> Trace:
        """Make the trace of the run, whose recording and texts are known by now."""
        gathered = list(self.configurations)
        if len(gathered) == len(recording.rounds):
            # The last round is one that was cut before anybody moved.
            gathered.append(gathered[-1])
        configurations, outputs = tuple(gathered), tuple(self.outputs)
        return Trace(sources, system, numbers, recording, configurations, outputs, violation)


def emitted(step: Step) -> Iterator[Emitted]:
    """Yield the outputs of a step, in the form of traces."""
    for written in step.stepped.output:
        yield Emitted(step.round, step.robot, written)


def traced(
    sources: Sources,
    system: System,
    numbers: Numbers,
    recording: Recording,
    violation: Violation | None = None,
) -> Trace:
    """Execute a recorded run into a trace. Raises IllegalStepError if the rules do not allow it."""
    return assembled(
        sources, system, numbers, recording, execute(numbers.domain, system, recording), violation
    )


def assembled(
    sources: Sources,
    system: System,
    numbers: Numbers,
    recording: Recording,
    steps: Iterable[Step],
    violation: Violation | None = None,
) -> Trace:
    """Make the trace of a run from its steps."""
    tracer = Tracer()
    for step in steps:
        tracer.add(step)
    return tracer.trace(sources, system, numbers, recording, violation)
