"""``--robots 2..10``: a verdict for each number of robots, as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from koord.cli.terminal import Paint, Style, visible
from koord.cli.verdicts import PAINT, outcome_of
from koord.syntax.problem import Problem

if TYPE_CHECKING:
    from koord.api.verify_report import VerifyReport


def heading(problem: Problem, style: Style) -> list[str]:
    """What stands above the table: what is the same for all numbers of robots."""
    return [
        style.paint(visible(f"{problem.name}: {', '.join(problem.values)}"), Paint.BOLD),
        "",
        f"  {'robots':>6}  {'outcome':<26}  {'engines':<20}  {'time':>9}",
    ]


def row(found: VerifyReport, style: Style) -> str:
    """One line of the table, to be printed as soon as it is known."""
    report = found.report
    shown = style.paint(outcome_of(report).ljust(26), PAINT[report.outcome])
    engines = ", ".join(engine.value for engine in found.engines)
    time = f"{report.seconds:.2f} s"
    return f"  {found.system.robots:>6}  {shown}  {engines:<20}  {time:>9}"
