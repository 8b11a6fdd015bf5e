"""``koord check-refinement --target simulator``: are runs in a world runs of the rules?"""

from __future__ import annotations

import argparse
import json
import sys

from msgspec import Struct, to_builtins

from koord.api.traces import write_trace
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.fitting import asked
from koord.cli.progress import Interruption, LiveLine
from koord.cli.simulated_traces import Tracing
from koord.cli.terminal import Paint, style_of, visible
from koord.refinement.judging import Judged
from koord.sim.running import run
from koord.syntax.diagnostics import KoordError

#: Of so many runs that are asked for one is made: a round in a world takes longer than without.
_SHARE = 50


class _Total(Struct):
    """What the runs of a program came to."""

    program: str
    values: str = ""  #: δ, and each value that is not the text's
    runs: int = 0
    rounds: int = 0
    steps: int = 0
    refused: str | None = None
    saved: str | None = None


def main(arguments: argparse.Namespace) -> int:
    """Simulate programs, judge their runs, tell of them, and return the exit code.

    Raises KoordError.
    """
    totals: list[_Total] = []
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        for file in arguments.files:
            total = _Total(file)
            totals.append(total)
            for number in range(-(-arguments.runs // _SHARE)):
                if interruption.requested:
                    break
                line.show(f"{file}: run {number + 1}")
                _judge(arguments, file, arguments.seed + number, total)
                if total.refused is not None:
                    break
    if arguments.json:
        sys.stdout.write(json.dumps([to_builtins(total) for total in totals], indent=2) + "\n")
    else:
        for total in totals:
            print(_told(total))
    if interruption.requested:
        return Exit.INTERRUPTED
    return Exit.VIOLATED if any(total.refused for total in totals) else Exit.OK


def _judge(arguments: argparse.Namespace, file: str, seed: int, total: _Total) -> None:
    files = argparse.Namespace(**{**vars(arguments), "file": file, "config": None, "delta": None})
    report = Report()
    wanted = asked(files, report)
    job = None if wanted is None else wanted.job(report, None, seed)
    if job is None:
        raise KoordError(tuple(report.diagnostics))
    total.values = ", ".join(job.problem.values)
    tracing = Tracing(job)
    simulation = job.simulation(keep_going=True, tracing=tracing)
    tracing.begun(simulation.begin(), simulation)
    job.check_start(simulation)
    for decision in run(simulation, job.limit_s(arguments.rounds, None)):
        tracing.round(decision, simulation)
    ran = tracing.ran(simulation)
    judged = tracing.judged(ran)
    total.runs += 1
    total.rounds += simulation.engine.round
    total.steps += judged.steps
    if judged.refused is not None:
        total.refused = _story(judged)
        total.saved = f"{arguments.save}/refinement-simulated-{seed}.json"
        write_trace(total.saved, tracing.trace(ran))


def _story(judged: Judged) -> str:
    refused = judged.refused
    assert refused is not None
    step = refused.step
    who = "" if step.robot is None else f", robot {step.robot}"
    when = "INIT" if step.round < 0 else f"round {step.round + 1}"
    return f"[{refused.rule}] {when}{who}: {refused.reason}"


def _told(total: _Total) -> str:
    style = style_of(sys.stdout)
    counted = f"{total.runs} runs, {total.rounds} rounds, {total.steps} steps"
    about = ", ".join(filter(None, (visible(total.values), counted)))
    if total.refused is None:
        return f"{visible(total.program)}: {about}: no violation"
    said = style.paint("refused", Paint.ERROR)
    saved = "" if total.saved is None else f", saved as {visible(total.saved)}"
    about = visible(f"{total.program}, {total.values}: {total.refused}")
    return f"{said}: {about}{saved}"
