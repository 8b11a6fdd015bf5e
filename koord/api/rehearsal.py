"""Rehearsal: a recorded run, such as a counterexample, replayed in the simulated world."""

from __future__ import annotations

from fractions import Fraction

from koord.api.fitting import NO_FILE, Fitted
from koord.api.programs import Program
from koord.api.progress import Cancellation, Listener
from koord.api.sim_report import Simulated
from koord.api.sim_run import SimulationRequest, play
from koord.api.sim_setup import watch
from koord.api.traces import read_trace, recorded_once
from koord.refinement.replaying_host import RecordedSchedule, ReplayingHost, places
from koord.refinement.running import ready
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.robot import Host
from koord.sim.running import Cast
from koord.sim.scene import POINT_SLACK_M
from koord.sim.staging import Staged
from koord.syntax.elaboration.settings import Settings
from koord.syntax.source import Source


def rehearse(
    source: Source,
    raw: bytes,
    name: str,
    request: SimulationRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Simulated:
    """Rehearse the run of a trace file of the program, given by its bytes and name.

    Raises KoordError.
    """
    trace = read_trace(raw, name, source)
    recorded_once(trace, "a rehearsal has")
    program, kinds = trace.system.program, trace.system.kinds
    made = ready(program)
    heard: list[ReplayingHost] = []

    def instead(host: Host) -> Host:
        heard.append(ReplayingHost(trace, made.names, host))
        return heard[0]

    def turned(number: int) -> None:
        heard[0].round = number

    staged = Staged(
        Cast(source.name, source.text, made.classes, kinds, trace.problem.differing),
        places(trace),
        float(trace.system.delta_s),
        RecordedSchedule(trace.recording.rounds, trace.recording.opening.order),
        instead,
        turned,
        cut=any(round_.cut for round_ in trace.recording.rounds),
    )
    watch(staged, program, max(Fraction(repr(POINT_SLACK_M)), trace.slack))
    of = trace.sources
    played = Program(source, program, Settings(dict(of.params), of.tasks), of.properties)
    nothing = load_configuration(Source(NO_FILE, f"num_robots: {len(kinds)}\n"))
    fitted = Fitted(played, nothing, kinds, staged.scene)
    return play(fitted, staged, request, None, progress, cancellation)
