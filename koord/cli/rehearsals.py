"""``koord sim --schedule``: a recorded run, such as a counterexample, played in the world."""

from __future__ import annotations

import argparse
from fractions import Fraction

from koord.api.programs import Program
from koord.api.traces import read_trace
from koord.cli.files import read_program, read_written
from koord.cli.fitting import NO_FILE
from koord.cli.simulating import Job, watching
from koord.refinement.replaying_host import RecordedSchedule, ReplayingHost, places
from koord.refinement.running import ready
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.robot import Host
from koord.sim.running import Cast
from koord.sim.scene import POINT_SLACK_M
from koord.sim.staging import Staged
from koord.syntax.elaboration.settings import Settings
from koord.syntax.source import Source


def rehearsal(arguments: argparse.Namespace) -> tuple[Job, Staged]:
    """The run that a trace of the program holds. Raises KoordError."""
    source = read_program(arguments.file).source
    trace = read_trace(read_written(arguments.schedule), arguments.schedule, source)
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
    watching(staged, program, max(Fraction(repr(POINT_SLACK_M)), trace.slack))
    of = trace.sources
    loaded = Program(source, program, Settings(dict(of.params), of.tasks), of.properties)
    nothing = load_configuration(Source(NO_FILE, f"num_robots: {len(kinds)}\n"))
    return Job(loaded, nothing, staged.scene, kinds), staged
