"""``koord check-refinement --target simulator``: are runs in a world runs of the rules?"""

from __future__ import annotations

import argparse
import json
import sys

from koord.api.refine_simulated import SimulatedRuns, judge_simulated
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.fitting import fit_request
from koord.cli.progress import Interruption, LiveLine
from koord.cli.terminal import Paint, style_of, visible
from koord.syntax.diagnostics import KoordError


def check_worlds(arguments: argparse.Namespace) -> int:
    """Simulate programs, judge their runs, tell of them, and return the exit code.

    Raises KoordError.
    """
    totals: list[SimulatedRuns] = []
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        for file in arguments.files:
            own = {**vars(arguments), "file": file, "config": None, "delta": None}
            report = DiagnosticReport()
            wanted = fit_request(argparse.Namespace(**own), report, seed=arguments.seed)
            if wanted is None:
                raise KoordError(tuple(report.diagnostics))
            made = judge_simulated(
                wanted,
                arguments.runs,
                arguments.rounds,
                arguments.save,
                lambda told: line.show(told.message),
                interruption,
            )
            totals.append(made)
    if arguments.json:
        sys.stdout.write(json.dumps([total.to_dict() for total in totals], indent=2) + "\n")
    else:
        for total in totals:
            print(_runs_line(total))
    if interruption.requested:
        return Exit.INTERRUPTED
    return Exit.VIOLATED if any(total.refused for total in totals) else Exit.OK


def _runs_line(total: SimulatedRuns) -> str:
    style = style_of(sys.stdout)
    counted = f"{total.runs} runs, {total.rounds} rounds, {total.steps} steps"
    about = ", ".join(filter(None, (visible(total.values), counted)))
    if total.refused is None:
        return f"{visible(total.program)}: {about}: no violation"
    said = style.paint("refused", Paint.ERROR)
    saved = "" if total.saved is None else f", saved as {visible(total.saved)}"
    about = visible(f"{total.program}, {total.values}: {total.refused}")
    return f"{said}: {about}{saved}"
