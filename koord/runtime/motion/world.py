"""Worlds as data: bounds, static obstacles, tasks, and the grid that maps are drawn on.

No number here needs a library, so a configuration can be read without any. Heights are z; an
obstacle is an upright prism that stands between two heights.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from msgspec import Struct

#: x, y, z in metres, in the one coordinate system that all robots share (paper, VI-B).
Point: TypeAlias = tuple[float, float, float]
Flat: TypeAlias = tuple[float, float]


class Box(Struct, frozen=True):
    """An upright box between two opposite corners."""

    low: Point
    high: Point

    @property
    def corners(self) -> tuple[Flat, ...]:
        (x0, y0, _), (x1, y1, _) = self.low, self.high
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1)

    @property
    def low_z(self) -> float:
        return self.low[2]

    @property
    def high_z(self) -> float:
        return self.high[2]


class Disc(Struct, frozen=True):
    """An upright cylinder."""

    centre: Flat
    radius_m: float
    low_z: float = 0.0
    high_z: float = math.inf


class Polygon(Struct, frozen=True):
    """An upright prism over a simple polygon (no edge crosses another), either way round."""

    corners: tuple[Flat, ...]
    low_z: float = 0.0
    high_z: float = math.inf


Obstacle: TypeAlias = Box | Disc | Polygon


class Grid(Struct, frozen=True):
    """The cells of a map: ``columns`` along x, ``rows`` along y, numbered row by row from 0."""

    origin: Flat
    cell_m: float
    columns: int
    rows: int

    @property
    def cells(self) -> int:
        return self.columns * self.rows

    def centre(self, cell: int) -> Flat:
        row, column = divmod(cell, self.columns)
        x, y = self.origin
        return x + (column + 0.5) * self.cell_m, y + (row + 0.5) * self.cell_m

    def cell(self, x: float, y: float) -> int | None:
        """The cell that a point lies in; None outside of the grid."""
        column = math.floor((x - self.origin[0]) / self.cell_m)
        row = math.floor((y - self.origin[1]) / self.cell_m)
        if 0 <= column < self.columns and 0 <= row < self.rows:
            return row * self.columns + column
        return None

    def beside(self, cell: int) -> tuple[int, ...]:
        """The up to four cells that share an edge with a cell."""
        row, column = divmod(cell, self.columns)
        around = ((row - 1, column), (row, column - 1), (row, column + 1), (row + 1, column))
        return tuple(
            r * self.columns + c for r, c in around if 0 <= r < self.rows and 0 <= c < self.columns
        )


class World(Struct, frozen=True):
    """A world. The defaults are the 7 × 8 × 3 m arena of the paper (VI-B).

    The plane that cars drive on is ``low[2]``.
    """

    low: Point = (-3.5, -4.0, 0.0)
    high: Point = (3.5, 4.0, 3.0)
    obstacles: tuple[Obstacle, ...] = ()
    tasks: tuple[Point, ...] = ()
    cell_m: float = 0.5

    @property
    def ground(self) -> float:
        return self.low[2]

    @property
    def grid(self) -> Grid:
        """The grid of maps: from the low corner, as many whole or broken cells as fit."""
        columns = math.ceil((self.high[0] - self.low[0]) / self.cell_m - 1e-9)
        rows = math.ceil((self.high[1] - self.low[1]) / self.cell_m - 1e-9)
        return Grid(self.low[:2], self.cell_m, columns, rows)
