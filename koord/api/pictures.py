"""Plots of many runs."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.files import write_atomically
from koord.api.results import ArgumentError
from koord.syntax.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from koord.api.verify_report import VerifyReport


def check_drawable(path: str) -> None:
    """Check that a plot can be made, before any work. Raises ArgumentError."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError:
        raise ArgumentError("plot", "needs matplotlib: pip install 'koord[plot]'") from None
    known = FigureCanvasAgg.get_supported_filetypes()
    if Path(path).suffix.removeprefix(".").lower() not in known:
        raise ArgumentError("plot", f"{path!r} is no picture; write times.svg or times.png")


def keep_figure(path: str, figure: Figure) -> None:
    """Write a plot, in the format of the file's suffix. Raises KoordError."""
    form = Path(path).suffix.removeprefix(".").lower()
    # Without a date, so that equal results give equal files.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(form)
    picture = io.BytesIO()
    figure.savefig(picture, format=form, metadata=undated)
    write_atomically(path, picture.getvalue())


def draw_sweep(path: str, problem: Problem, points: Sequence[VerifyReport]) -> None:
    """Plot time against the number of robots. Raises KoordError."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    from koord.verify.verdicts import Outcome

    markers = {Outcome.HOLDS: "o", Outcome.VIOLATED: "X", Outcome.UNKNOWN: "s"}
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    seconds = {point.system.robots: point.seconds for point in points}
    axes.plot(list(seconds), list(seconds.values()), color="0.7", zorder=1)
    for outcome, marker in markers.items():
        robots = [p.system.robots for p in points if p.outcome is outcome]
        if robots:
            times = [seconds[n] for n in robots]
            axes.scatter(robots, times, marker=marker, label=outcome.value, zorder=2)
    axes.set(xlabel="robots", ylabel="time in s")
    short = replace(problem, texts=tuple(Path(name).name for name in problem.texts))
    title = f"{short.name}: {', '.join(short.values)}"
    axes.set_title(title, wrap=True, parse_math=False)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    keep_figure(path, figure)
