"""Refinement of simulated runs: are they runs of the semantics?"""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

from msgspec.structs import replace

from koord.api.files import file_name
from koord.api.fitting import Configurable, FitRequest, fit, fit_request
from koord.api.programs import Loadable, Value
from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.results import Result
from koord.api.sim_setup import check_begun, limit_s, simulation
from koord.api.sim_trace import Tracing
from koord.api.traces import write_trace
from koord.refinement.judging import Judged
from koord.sim.running import Simulation, run

#: Of so many runs that are asked for one is made: a round in a world takes longer than without.
_SHARE = 50


class SimulatedRuns(Result, frozen=True):
    """The result of a program's simulated runs, judged by the reference."""

    program: str
    values: str = ""  #: δ, and each value that is not the text's
    runs: int = 0
    rounds: int = 0
    steps: int = 0
    refused: str | None = None  #: the first step that the rules do not allow
    saved: str | None = None  #: the file of its trace

    @property
    def ok(self) -> bool:
        """True if no run was refused."""
        return self.refused is None

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord check-refinement --json`` prints it."""
        return {name: getattr(self, name) for name in self.__struct_fields__}

    def __repr__(self) -> str:
        said = "no violation" if self.refused is None else f"refused: {self.refused}"
        counted = f"{self.runs} runs, {self.rounds} rounds, {self.steps} steps"
        return f"<SimulatedRuns {self.program}: {counted}: {said}>"


def refine_simulated(
    program: Loadable,
    config: Configurable = None,
    *,
    runs: int = 100,
    rounds: int = 8,
    seed: int = 0,
    params: Mapping[str, Value] | None = None,
    save: str | PathLike[str] | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> SimulatedRuns:
    """Simulate a program with seeds that follow ``seed``, and judge each run by the rules.

    Of so many ``runs`` every fiftieth is made, with up to so many ``rounds``: a round in a world
    takes longer than without. It ends with the first run that is refused, whose trace goes to the
    folder ``save``. Raises :class:`koord.KoordError` for what is wrong with the input.

    >>> koord.refine_simulated("task.krd").ok
    True
    """
    wanted = fit_request(program, config, params, None, seed, None)
    folder = file_name(save)
    return judge_simulated(wanted, runs, rounds, folder, progress, cancellation)


def judge_simulated(
    wanted: FitRequest,
    runs: int,
    rounds: int,
    save: str | None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> SimulatedRuns:
    """As :func:`refine_simulated`, for a request with a seed. Raises KoordError."""
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    assert wanted.seed is not None
    found = SimulatedRuns(wanted.source.name)
    for number in range(-(-runs // _SHARE)):
        if is_cancelled() or found.refused is not None:
            break
        tell(Progress(f"{wanted.source.name}: run {number + 1}"))
        found = _judged(replace(wanted, seed=wanted.seed + number), rounds, save, found)
    return found


def _judged(
    wanted: FitRequest, rounds: int, save: str | None, before: SimulatedRuns
) -> SimulatedRuns:
    """Make and judge one more run."""
    fitted = fit(wanted)
    tracing = Tracing(fitted)
    made = simulation(fitted, Simulation, keep_going=True, tracing=tracing.hear)
    tracing.heard(made.begin(), made)
    check_begun(fitted, made)
    for decision in run(made, limit_s(fitted, rounds, None)):
        tracing.heard(decision, made)
    ran = tracing.ran(made)
    judged = tracing.judged(ran)
    found = replace(
        before,
        values=", ".join(fitted.problem.values),
        runs=before.runs + 1,
        rounds=before.rounds + made.engine.round,
        steps=before.steps + judged.steps,
    )
    if judged.refused is None:
        return found
    path = None
    if save is not None:
        path = f"{save}/refinement-simulated-{wanted.seed}.json"
        write_trace(path, tracing.trace(ran))
    return replace(found, refused=_story(judged), saved=path)


def _story(judged: Judged) -> str:
    refused = judged.refused
    assert refused is not None
    step = refused.step
    who = "" if step.robot is None else f", robot {step.robot}"
    when = "INIT" if step.round < 0 else f"round {step.round + 1}"
    return f"[{refused.rule}] {when}{who}: {refused.reason}"
