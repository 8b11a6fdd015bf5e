"""A planner: the shortest way over the cells of a grid, by A*."""

import heapq
import math

from msgspec import Struct

from koord.runtime.motion.field import field


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    cell: float = 0.25  #: m


class GridPlanner:
    OPTIONS = Options

    def __init__(self, site):
        self.free, self.cell = field(site.world, flat=True), site.options.cell
        self.radius = site.body.radius_m + 0.05

    def plan(self, start, goal, seed, avoid=()):
        """Between the cells of start and goal; each step is free of obstacles."""
        z, first = start.position[2], self.index(start.position)
        last, open_, best = self.index(goal), [(0.0, first)], {first: (0.0, None)}
        while open_:
            _, here = heapq.heappop(open_)
            if here == last:
                cells = []
                while here is not None:
                    cells.append(here)
                    here = best[here][1]
                middle = [(*self.at(one), z) for one in cells[-2:0:-1]]
                return [start.position, *middle, goal]
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                there = here[0] + dx, here[1] + dy
                far = best[here][0] + math.hypot(dx, dy)
                if far < best.get(there, (math.inf,))[0] and self.is_free(there, z, avoid):
                    best[there] = far, here
                    heapq.heappush(open_, (far + math.dist(there, last), there))
        return None

    def is_free(self, cell, z, avoid):
        x, y = self.at(cell)
        near = any(math.dist((x, y), point[:2]) < self.radius + 0.25 for point in avoid)
        return not near and self.free.clearance(x, y, z) > self.radius

    def index(self, point):
        return round(point[0] / self.cell), round(point[1] / self.cell)

    def at(self, cell):
        return cell[0] * self.cell, cell[1] * self.cell
