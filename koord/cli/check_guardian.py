"""``koord check-refinement --target guardian``: its proof and exploration, as they are shown."""

from __future__ import annotations

import argparse
import sys
from itertools import groupby
from typing import TYPE_CHECKING

from koord.cli.progress import Interruption, LiveLine
from koord.cli.proofs import code_of_proof
from koord.syntax.source import counted

if TYPE_CHECKING:
    from koord.api.guardian_check import GuardianCheck


def check_guardian_alone(arguments: argparse.Namespace) -> int:
    """Check the guardian, print the result, and return the exit code."""
    from koord.api.guardian_check import check_guardian

    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        checked = check_guardian(
            progress=lambda told: line.show(told.message), cancellation=interruption
        )
    if arguments.json:
        sys.stdout.write(checked.to_json() + "\n")
    else:
        _show(checked)
    return code_of_proof(checked)


def _show(checked: GuardianCheck) -> None:
    left_open = set(checked.open)
    for (action, rule), steps in groupby(checked.steps, lambda one: (one.action, one.rule)):
        of_it = tuple(steps)
        kept = counted(len(of_it) - len(left_open.intersection(of_it)), "invariant")
        print(f"{action} ({rule}): {kept} kept")
    for step in checked.open:
        print(f"not proved ({step.answer.value}): {step.action}: {step.statement}")
        for fact in step.counterexample:
            print(f"  {fact}")
    for what, one in checked.explored.items():
        end = "all of them" if one.complete else f"to depth {one.depth}"
        print(f"{what}: {one.states:,} states, {one.transitions:,} transitions, {end}")
    for violation in checked.violations:
        print("\n".join(f"  {line}" for line in violation.story))
        print(f"broken: {violation.broken.claim}: {violation.broken.story}")
    if checked.ok:
        print(f"proved for all limits, times and facts: {', '.join(checked.invariants)}")
