"""What is done when a simulated run is over: its trace, its report, its files, the exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from koord.api.growing import remove_part
from koord.cli.exits import Exit
from koord.cli.keeping import keep
from koord.cli.simulated import as_document, conclusion, table
from koord.cli.simulating import Job
from koord.cli.terminal import visible
from koord.sim.running import Ending, Simulation

if TYPE_CHECKING:
    from koord.cli.simulated_traces import Tracing


def concluded(
    arguments: argparse.Namespace,
    job: Job,
    simulation: Simulation,
    tracing: Tracing | None,
    wall_s: float,
    *,
    more: Mapping[str, Any] | None = None,
    lines: Sequence[str] = (),
) -> Exit:
    """Tell of a run and keep what is asked for. Raises KoordError.

    ``more`` is told besides in the JSON document, ``lines`` behind the table.
    """
    told = None
    if tracing is not None:
        from koord.api.traces import complete_trace

        ran = tracing.ran(simulation)
        complete_trace(arguments.trace, tracing.trace(ran))
        remove_part(arguments.trace)
        told = tracing.judged(ran)
    if arguments.json:
        sys.stdout.write(as_document(job, simulation, wall_s, more or {}))
    else:
        for text in (*table(simulation, wall_s), *lines, *conclusion(job, simulation)):
            print(text)
    kept = keep(arguments, simulation.recording)
    if kept and not arguments.json:
        print(f"kept: {', '.join(map(visible, kept))}")
    if told is not None and told.refused is not None:
        print(
            f"the trace is none of the semantics: [{told.refused.rule}] {told.refused.reason}",
            file=sys.stderr,
        )
        return Exit.VIOLATED
    return _code(simulation)


def _code(simulation: Simulation) -> Exit:
    if simulation.ending is Ending.INTERRUPTED:
        return Exit.INTERRUPTED
    broken = bool(simulation.broken) or simulation.fault is not None
    if broken:
        return Exit.VIOLATED
    return Exit.STUCK if simulation.standing else Exit.OK
