"""Plots of a run: positions against time, and the growth of a map. Needs ``koord[plot]``."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from koord.runtime.shapes import Array, Enumeration
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Header,
    RunLog,
    TaskState,
    map_variable,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = ("#2f6fde", "#b8429a", "#0e8f9e", "#8a6428", "#6c4bd8", "#5a7182", "#2f93d8", "#a03c62")
_DONE, _BAD = "#1d8a4e", "#cc2936"

#: Lines of so many robots get their numbers.
_NUMBERED = 12

#: A map is shown at so many times.
_MAPS = 4

#: Cells of a map: nothing known, nothing there, something there.
_UNKNOWN, _FREE, _OCCUPIED = 0, 1, 2


def plot_of(recording: RunLog, form: str) -> bytes:
    """Plot a run in a format (``.png``, ``.svg``, ``.pdf``).

    x, y and, where somebody flies, z against time: cars solid, drones dashed (paper, VI-B).

    Below them the map at some times, if the program draws one.
    """
    from matplotlib.figure import Figure

    header = recording.header
    axes = "xyz" if any(robot.look.flies for robot in header.robots) else "xy"
    number = map_variable(header)
    maps = maps_of(recording, number) if number is not None else []
    rows = len(axes) + bool(maps)
    figure = Figure(figsize=(8.5, 1.9 * len(axes) + 2.6 * bool(maps) + 0.4), layout="constrained")
    grid = figure.add_gridspec(rows, max(len(maps), 1))
    first: Axes | None = None
    for row, name in enumerate(axes):
        drawn = figure.add_subplot(grid[row, :], sharex=first)
        _against_time(drawn, recording, row)
        drawn.set_ylabel(f"{name} (m)")
        first = first if first is not None else drawn
        drawn.tick_params(labelbottom=row == len(axes) - 1)
    drawn.set_xlabel("time (s)")
    for column, (time_s, cells) in enumerate(maps):
        _map(figure.add_subplot(grid[rows - 1, column]), header, cells, time_s)
    name = header.program.replace("\\", "/").rsplit("/")[-1]
    title = f"{name}: {', '.join(header.differing)}" if header.differing else name
    figure.suptitle(title, fontsize=11, wrap=True, parse_math=False)
    raw = io.BytesIO()
    # Without the date equal runs make equal files.
    dated: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    name = form.removeprefix(".")
    figure.savefig(raw, format=name, dpi=150, metadata=dated.get(name))
    return raw.getvalue()


def _against_time(axes: Axes, recording: RunLog, component: int) -> None:
    header, poses = recording.header, recording.stacked()
    times = np.array(recording.times_s)
    for k, robot in enumerate(header.robots):
        style = "-" if not robot.look.flies else "--" if robot.look.tilts else ":"
        colour = _COLOURS[k % len(_COLOURS)]
        axes.plot(times, poses[:, k, component], style, color=colour, linewidth=1.2)
        if len(header.robots) <= _NUMBERED and len(times):
            end = (times[-1], poses[-1, k, component])
            axes.annotate(
                str(k),
                end,
                (4, 0),
                textcoords="offset points",
                color=colour,
                fontsize=8,
                va="center",
            )
    for change in recording.tasks:
        if change.state is TaskState.DONE:
            at = header.world.tasks[change.task][component]
            axes.plot(change.time_s, at, "o", color=_DONE, markersize=4, markerfacecolor="none")
    for violation in recording.violations:
        axes.axvline(violation.time_s, color=_BAD, linewidth=0.8, linestyle="-.")
    axes.grid(color="#e3e7ee", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


# --- maps -----------------------------------------------------------------------------------------


def maps_of(recording: RunLog, number: int) -> list[tuple[float, NDArray[np.int8]]]:
    """Samples of a map over time: the cells, shape ``(rows, columns)``."""
    header = recording.header
    rounds = recording.rounds
    if not rounds:
        return []
    wanted = {round(share * (len(rounds) - 1)) for share in np.linspace(0, 1, _MAPS)}
    found, held = [], None
    for k, done in enumerate(rounds):
        for robot, variable, part, value in done.changes:
            if robot == SHARED and variable == number:
                if part == WHOLE:
                    held = list(value) if isinstance(value, tuple) else None
                elif held is not None:
                    held[part] = value
        if k in wanted:
            found.append((done.time_s, _cells(header, number, held)))
    return found


def _cells(header: Header, number: int, held: Any) -> NDArray[np.int8]:
    grid, shape = header.world.grid, header.shared[number].shape
    cells = np.full(grid.cells, _UNKNOWN, np.int8)
    match shape:
        case Array(element=Enumeration(members=members)):
            unknown, free = members.index("unknown"), members.index("free")
            for cell, value in enumerate(held or ()):
                if value is not None and value != unknown:
                    cells[cell] = _FREE if value == free else _OCCUPIED
        case _:
            for cell, occupied in held or ():
                if 0 <= cell < grid.cells:
                    cells[cell] = _OCCUPIED if occupied else _FREE
    return cells.reshape(grid.rows, grid.columns)


def _map(axes: Axes, header: Header, cells: NDArray[np.int8], time_s: float) -> None:
    from matplotlib.colors import ListedColormap

    (x0, y0), grid = header.world.grid.origin, header.world.grid
    extent = (x0, x0 + grid.columns * grid.cell_m, y0, y0 + grid.rows * grid.cell_m)
    shades = ListedColormap(["#d5dbe4", "#ffffff", "#39424f"])
    axes.imshow(cells, origin="lower", extent=extent, cmap=shades, vmin=0, vmax=2)
    known = (cells != _UNKNOWN).mean()
    axes.set_title(f"{time_s:.0f} s: {known:.0%} known", fontsize=9)
    axes.tick_params(labelsize=7)
