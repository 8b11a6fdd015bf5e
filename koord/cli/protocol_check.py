"""``koord check-refinement --target protocol``: the round-commit protocol itself."""

from __future__ import annotations

import argparse
import sys

from koord.api.protocol_check import ProtocolCheck, check_protocol
from koord.cli.exits import Exit


def check_protocol_alone(arguments: argparse.Namespace) -> int:
    """Check, tell, and return the exit code."""
    checked = check_protocol(runs=arguments.runs, seed=arguments.seed, faults=arguments.faults)
    if arguments.json:
        sys.stdout.write(checked.to_json() + "\n")
    else:
        _show_protocol(checked, arguments.faults)
    return Exit.VIOLATED if checked.broken else Exit.OK


def _show_protocol(checked: ProtocolCheck, network: str) -> None:
    for what, one in checked.explored.items():
        end = "all of them" if one.complete else f"to depth {one.depth}"
        print(f"{what}: {one.states:,} states, {one.transitions:,} transitions, {end}")
    rounds = sum(run.rounds for run in checked.runs)
    crashes = sum(run.crashes for run in checked.runs)
    late = sum(run.skips_late for run in checked.runs)
    print(
        f"{len(checked.runs)} runs on simulated networks ({network}): {rounds:,} rounds, "
        f"{late:,} late proposals, {crashes:,} crashes"
    )
    for one in checked.explored.values():
        if one.violation is not None:
            print("\n".join(f"  {line}" for line in one.violation.story))
    for story in checked.broken:
        print(f"broken: {story}")
    if not checked.broken:
        print("every invariant of specs/protocol held")
