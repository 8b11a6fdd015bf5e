"""Runs that are split: repeated up to a mark, and by new chance from there on."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Protocol, runtime_checkable

from msgspec import Struct
from msgspec.structs import replace

from koord.api.fitting import FitRequest, Fitted, elaborated
from koord.api.progress import CancelledError
from koord.api.reseeding import Reseeding
from koord.api.sim_setup import check_begun, limit_s, simulation
from koord.runtime.compile.levels import LevelCode, level_of
from koord.runtime.compile.watching import WatchedKind
from koord.sim.levels import ClaimGauge, LevelMonitor, closeness
from koord.sim.running import Simulation, run
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal
from koord.syntax.source import Source, is_whole_file

#: The claim of the simulator itself, that robots keep the distance that is safe; and no claim.
SEPARATION, FAULT = "separation", "fault"

_SORTS = {
    PropertyKind.INVARIANT: WatchedKind.INVARIANT.value,
    PropertyKind.AT_ROUND: WatchedKind.AT_ROUND.value,
}

#: The highest level of a run that breaks nothing.
_MOST = math.nextafter(math.inf, 0.0)

#: What the level that people give is called where it is elaborated.
_LEVEL = "LevelOfSplitting"

#: The text that it is elaborated as begins so, and is named as the flag that has it.
_BEFORE, _SOURCE = f"invariant {_LEVEL}: (", "<level>"

_CURE = "say how near it is with `level=`: a number that goes up as it comes nearer"


class Target(Struct, frozen=True):
    """A claim of which it is asked how often it is broken: its name in a run, and its level."""

    broken: str
    code: LevelCode | None  #: None: how near robots are to each other


class Mark(Struct, frozen=True):
    """Where a run came above all levels before: after which look, and what it was then."""

    looks: int  #: 0 after INIT, then one more after each round
    level: float
    state: bytes


class Chance(Struct, frozen=True):
    """What chance hangs on after a look, at which the run is in a known state."""

    looks: int
    seed: int
    state: bytes


class SplitRun(Struct, frozen=True):
    """A run that was made: of a seed, and then of other chance."""

    seed: int
    chances: tuple[Chance, ...]
    marks: tuple[Mark, ...]
    end: bytes  #: what it was at its end


def target_of(request: FitRequest, fitted: Fitted, claim: str, level: str | None) -> Target:
    """The target of a claim, by its name. Raises KoordError."""
    program = fitted.program.core
    named = {
        f"{sort} {one.name}": one for one in program.properties if (sort := _SORTS.get(one.kind))
    }
    contracts = {
        f"{WatchedKind.CONTRACT.value} {contract.name}"
        for agent in program.agents
        for module in agent.modules
        for contract in module.contracts
        if module.environment is None
    }
    apart = {SEPARATION} if fitted.scene.safety_m > 0 else set()
    known = [*named, *sorted(contracts), *sorted(apart), FAULT]
    found = [one for one in known if claim in (one, one.rpartition(" ")[2])]
    if not found:
        story = f"no run of the program can break a claim {claim!r}"
        raise refusal("K956", "<splitting>", story, f"there are {', '.join(known)}")
    broken = found[0]
    if level is not None:
        return Target(broken, _given(request, fitted, level))
    if broken == SEPARATION:
        return Target(broken, None)
    stated = named.get(broken)
    code = None if stated is None else level_of(program, stated)
    if code is None:
        story = f"nothing says how near a run is to breaking {broken}: it compares no numbers"
        raise refusal("K956", "<splitting>" if stated is None else stated.span, story, _CURE)
    return Target(broken, code)


def _given(request: FitRequest, fitted: Fitted, text: str) -> LevelCode:
    """The level that people give: a number, or a comparison of some. Raises KoordError."""
    errors = list[KoordError]()
    for form in (f"({text}) <= 0", f"({text})"):
        source = Source(_SOURCE, f"{_BEFORE[:-1]}{form}\n")
        more = replace(request, properties=(*request.properties, source))
        try:
            program = elaborated(more, fitted.program.settings).core
        except KoordError as error:
            errors.append(error)
            continue
        (stated,) = [one for one in program.properties if one.name == _LEVEL]
        code = level_of(program, stated)
        if code is not None:
            return code
        story = "this says nothing of how near a run is: it compares no numbers"
        raise refusal("K956", stated.span, story, _CURE)
    raise KoordError(tuple(_moved(one) for one in errors[0].diagnostics))


def _moved(diagnostic: Diagnostic) -> Diagnostic:
    """A diagnostic of the level, with its place in what people gave."""
    span = diagnostic.span
    if span.file != _SOURCE or is_whole_file(span):
        return diagnostic
    first, last = (max(1, c - len(_BEFORE)) for c in (span.column, span.end_column))
    return replace(diagnostic, span=replace(span, column=first, end_column=last))


class SplitRuns:
    """The maker of a target's runs.

    ``ends`` are what runs by chance were at their ends, and ``equal`` of the ``branches`` ended as
    the run that they were made of. Raises KoordError where a run is not what it was when it is
    repeated, and CancelledError.
    """

    def __init__(
        self,
        common: Reseeding,
        target: Target,
        rounds: int | None,
        duration_s: float | None,
        kernels: bool = True,
        is_enough: Callable[[], bool] = lambda: False,
    ) -> None:
        self._reseeding, self._target = common, target
        self._rounds, self._duration_s, self._kernels = rounds, duration_s, kernels
        self._is_enough = is_enough
        self.ends = set[bytes]()
        self.branches, self.equal = 0, 0

    def begun(self, seed: int) -> SplitRun:
        """The run with a seed."""
        made = self._made(seed, ())
        self.ends.add(made.end)
        return made

    def branched(self, particle: SplitRun, mark: Mark, seed: int) -> SplitRun:
        """A run that is as another up to a mark of it, and by new chance from there on."""
        known = tuple(chance for chance in particle.chances if chance.looks < mark.looks)
        made = self._made(particle.seed, (*known, Chance(mark.looks, seed, mark.state)))
        if mark.level < math.inf:  # else it is over at the mark
            self.branches += 1
            self.equal += made.end == particle.end
        return made

    def _made(self, seed: int, chances: tuple[Chance, ...]) -> SplitRun:
        fitted, built = self._reseeding.run(seed)
        made = simulation(fitted, Simulation, keep_going=True, built=built, kernels=self._kernels)
        code = self._target.code
        monitor = LevelMonitor(closeness if code is None else ClaimGauge(code, made))
        made.claims.append(monitor)
        made.begin()
        check_begun(fitted, made)
        marks, left = list[Mark](), deque(chances)
        rounds = run(made, limit_s(fitted, self._rounds, self._duration_s))
        for looks in count():
            level = math.inf if self._is_broken(made) else min(monitor.highest, _MOST)
            if not marks or level > marks[-1].level:
                marks.append(Mark(looks, level, _state(made)))
            if left and left[0].looks == looks:
                chance = left.popleft()
                if chance.state != _state(made):
                    raise _other(seed, looks)
                _reseed(made, chance.seed)
            if self._is_enough():
                raise CancelledError("while runs were split")
            if level == math.inf or next(rounds, None) is None:
                break
        made.fleet.close()
        return SplitRun(seed, chances, tuple(marks), _state(made))

    def _is_broken(self, made: Simulation) -> bool:
        if self._target.broken == FAULT:
            return made.fault is not None
        return any(one.claim == self._target.broken for one in made.broken)


def _reseed(made: Simulation, seed: int) -> None:
    """Let all chance to come in a run hang on a seed."""
    made.host.reseed(seed)
    host: object = made.claims_host
    if isinstance(host, _Drawing) and host is not made.host:
        host.reseed(seed)


@runtime_checkable
class _Drawing(Protocol):
    """A host that draws by itself, beside the world."""

    def reseed(self, seed: int) -> None: ...


def _state(made: Simulation) -> bytes:
    """A digest of what a run has been, and of what its robots hold."""
    held = [[*vars(robot).items()] for robot in made.engine.robots]
    whole = (made.digest, [*made.engine.store.values.items()], held)
    return hashlib.blake2b(repr(whole).encode(), digest_size=16).digest()


def _other(seed: int, looks: int) -> KoordError:
    story = f"the run of seed {seed} is another one after {looks} rounds when it is repeated"
    hint = "splitting repeats runs: what plug-ins and external functions do has to hang on the seed"
    return refusal("K955", "<splitting>", story, hint)
