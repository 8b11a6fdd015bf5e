"""``--robots 2..10``: a verdict for each number of robots, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.pictures import keep_figure
from koord.cli.terminal import Paint, Style, visible
from koord.cli.verdicts import PAINT, outcome_of
from koord.syntax.problem import Problem
from koord.verify.engine_names import Engine
from koord.verify.verdicts import Outcome

if TYPE_CHECKING:
    from koord.api.verdicts import VerifyReport

_MARKERS = {Outcome.HOLDS: "o", Outcome.VIOLATED: "X", Outcome.UNKNOWN: "s"}


def heading(problem: Problem, style: Style) -> list[str]:
    """What stands above the table: what is the same for all numbers of robots."""
    return [
        style.paint(visible(_title(problem)), Paint.BOLD),
        "",
        f"  {'robots':>6}  {'outcome':<26}  {'engines':<20}  {'time':>9}",
    ]


def _title(problem: Problem) -> str:
    return f"{problem.name}: {', '.join(problem.values)}"


def row(found: VerifyReport, style: Style) -> str:
    """One line of the table, to be printed as soon as it is known."""
    report = found.report
    shown = style.paint(outcome_of(report).ljust(26), PAINT[report.outcome])
    used = dict.fromkeys(v.engine for v in report.verdicts if v.engine is not Engine.NONE)
    engines = ", ".join(engine.value for engine in used)
    time = f"{report.seconds:.2f} s"
    return f"  {found.system.robots:>6}  {shown}  {engines:<20}  {time:>9}"


def draw(path: str, problem: Problem, points: Sequence[VerifyReport]) -> None:
    """Time against the number of robots, as a picture. Raises KoordError."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    seconds = {point.system.robots: point.seconds for point in points}
    axes.plot(list(seconds), list(seconds.values()), color="0.7", zorder=1)
    for outcome, marker in _MARKERS.items():
        robots = [p.system.robots for p in points if p.outcome is outcome]
        if robots:
            times = [seconds[n] for n in robots]
            axes.scatter(robots, times, marker=marker, label=outcome.value, zorder=2)
    axes.set(xlabel="robots", ylabel="time in s")
    names = tuple(Path(name).name for name in problem.texts)
    axes.set_title(_title(replace(problem, texts=names)), wrap=True, parse_math=False)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    keep_figure(path, figure)
