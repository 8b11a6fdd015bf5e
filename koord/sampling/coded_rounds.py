"""Runs that go by whole rounds, where code makes them and all claims hold. [RECORDING]

A round that code is in doubt about is left to the rules from the turn on that the doubt is about.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from functools import cache
from random import Random

from koord.sampling.compiled.expressions import NoCodeError
from koord.sampling.compiled.halts import Halt, Stage
from koord.sampling.compiled.round_claims import Claims
from koord.sampling.compiled.round_log import RoundLog
from koord.sampling.compiled.rounds import RoundCode, usual_unit
from koord.sampling.compiled.turns import Turns
from koord.sampling.made_rounds import Chosen, MadeRound, TakenStep, turns_of
from koord.sampling.running import ProgramTurn, Run, RunState
from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Step
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.diagnostics import KoordError

#: So many rounds may halt for doubts before code has to make more rounds than halt.
_FEW_HALTS = 30


class CodedRounds:
    """The rounds of a run by code. It halts where something is in doubt, and can go on later."""

    def __init__(self, run: Run, chosen: Chosen, claims: Callable[[], Claims | None]) -> None:
        self._run = run
        self._chosen = chosen
        self._claims = claims
        self._code: RoundCode | None = None
        self._given_up = False
        self._halts = self._made = 0
        #: The steps of a round that halted, up to what the rules have to do themselves.
        self.opened: tuple[TakenStep, ...] = ()
        #: The environment's turn that the rules have taken already, and the moment before it.
        self.sensed: tuple[TakenStep, RunState] | None = None
        self.halt = Halt(Stage.WHOLE, -1, None)

    @property
    def has_halted(self) -> bool:
        """Return whether the rules have to go on in the last round."""
        return self.halt.stage not in (Stage.WHOLE, Stage.SENSING)

    def holds(self) -> bool:
        """Return whether code can tell that all claims hold in the present configuration."""
        code = self._ready()
        return code is not None and code.holds()

    def rounds(self, most: int) -> Iterator[MadeRound]:
        """Make rounds until one halts, or so many are over; then the ``halt`` is known.

        A turn of a round that halts was taken if all claims hold after it for sure.
        """
        self.opened, self.sensed, self.halt = (), None, Halt(Stage.WHOLE, -1, None)
        code = self._ready()
        if code is None:
            return
        run = self._run
        while run.round < most and code.anyone_runs:
            number, start = code.round, run.configuration if code.senses else None
            self.halt = Halt(Stage.ENVIRONMENT, -1, None)
            try:
                self.halt = code.play()
            except (KoordError, OutOfBudgetError):
                self._come_to(code, number, start)
                raise
            log, ran_before, evolved = code.log, tuple(code.ran_before), None
            if self.halt.stage != Stage.WHOLE:
                self._come_to(code, number, start)
            if self.halt.stage == Stage.SENSING:
                evolved = self._sense(code)
            if self.has_halted:
                break
            made = MadeRound(number, log, code, ran_before, start, evolved)
            self._made += 1
            if evolved is None:
                code.close()
                run.go_ahead(code, [(turn[0], turn[1]) for turn in log.turns])
            yield made
            self.opened = ()
        if self.has_halted:
            self._doubt(code)

    def _sense(self, code: RoundCode) -> Step:
        """Take the environment's turn by the rules; halt where it is not all well after it."""
        run = self._run
        moment = run.moment
        evolved = run.evolve()
        after = evolved.configuration
        code.state.show(after)
        if (
            code.state.is_uneven
            or evolved.stepped.promises
            or after.fault is not None
            or not code.end()
        ):
            self.sensed = TakenStep(evolved, before=moment.configuration), moment
            self.halt = Halt(Stage.END, -1, None)
        return evolved

    def _come_to(self, code: RoundCode, number: int, start: Configuration[Constant] | None) -> None:
        """Let the run come to where a round halted: the rules do again what claims are asked of."""
        match self.halt.stage:
            case Stage.CLAIMS:
                code.undo_turn()
            case Stage.ENVIRONMENT | Stage.END:
                code.undo_environment()
        turns = code.log.turns
        if start is None:
            start = code.configuration()
        self.opened = tuple(turns_of(code, RoundLog(turns), start, number))
        last = self.opened[-1].step.configuration if self.opened else start
        moves = tuple(ProgramTurn(robot, event) for robot, event, *_ in turns)
        self._run.go_on(RunState(last, number, moves))
        code.close()

    # --- the code --------------------------------------------------------------------------------

    def _ready(self) -> RoundCode | None:
        """The code, when it shows the present configuration; None if there is none."""
        claims = self._claims()
        if self._given_up or claims is None or self._run.configuration.fault is not None:
            return None
        code = self._code
        if code is None or not code.claims.includes(claims):
            code = self._code = self._found(claims)
            if code is None:
                self._given_up = True
                return None
        code.seek(claims.sought)
        code.state.show(self._run.configuration)
        code.close()
        if not code.state.is_uneven:
            return code
        self._count_no_units(code)
        return self._ready()

    def _found(self, claims: Claims) -> RoundCode | None:
        turns, chosen = self._run.turns, self._chosen
        if type(turns) is not Turns or type(self._run.inputs) is not SampledInputs:
            return None
        if not (chosen.rng is None or (type(chosen.rng) is Random and _draws_as_random_does())):
            return None
        code = self._free(claims)
        if code is None:
            unit = usual_unit(turns.d, turns.system)
            code = self._made_with(claims, unit)
            if code is None and unit is not None:
                code = self._made_with(claims, None)
        if code is not None:
            turns.rounds.append((weakref.ref(self._run), code))
            code.serve(self._run.inputs, chosen.rng, chosen.skips_percent)
        return code

    def _free(self, claims: Claims) -> RoundCode | None:
        """Code that another run of the system had, which is no more."""
        rounds = self._run.turns.rounds
        for at, (owner, code) in enumerate(rounds):
            same = code.schedule is self._chosen.schedule and code.claims.includes(claims)
            if same and owner() in (None, self._run):
                del rounds[at]
                return code
        return None

    def _made_with(self, claims: Claims, unit: int | None) -> RoundCode | None:
        turns = self._run.turns
        try:
            return RoundCode(turns.d, turns.system, self._chosen.schedule, claims, unit)
        except NoCodeError:
            return None

    def _doubt(self, code: RoundCode) -> None:
        """Do without code that halts most often; first without counting floats in units."""
        self._halts += 1
        if self._halts > _FEW_HALTS and self._halts > self._made:
            self._count_no_units(code)

    def _count_no_units(self, code: RoundCode) -> None:
        """Do with code that does not count floats in units, or with none."""
        self._halts = self._made = 0
        self._code = None if code.unit is None else self._made_with(code.claims, None)
        if self._code is None:
            self._given_up = True
        else:
            chosen = self._chosen
            self._code.serve(self._run.inputs, chosen.rng, chosen.skips_percent)


@cache
def _draws_as_random_does() -> bool:
    """Return whether this Python's generator draws from lists as code does."""
    one, other = Random(0), Random(0)
    drawn = []
    for count in (*range(1, 65), 100, 100):
        at = other.getrandbits(count.bit_length())
        while at >= count:
            at = other.getrandbits(count.bit_length())
        drawn.append(at)
    by_choice = [one.choice(range(count)) for count in range(1, 65)]
    by_range = [one.randrange(100), one.randrange(100)]
    return drawn == [*by_choice, *by_range] and one.random() == other.random()
