"""Runs that differ in their seeds alone: what they have in common is made once.

The seed says where robots and tasks are that nobody places. Text and configuration are read, the
program elaborated, and it and its claims compiled, for the first run only: places of tasks are put
into what was made of them.
"""

from __future__ import annotations

from fractions import Fraction

from msgspec.structs import replace

from koord.api.fitting import (
    FitRequest,
    Fitted,
    configured,
    elaborated,
    fit,
    landmarks_of,
    slack_of,
)
from koord.api.sim_setup import Built, build, cast
from koord.runtime.compile.starting import StartCompiler
from koord.runtime.compile.watching import watched
from koord.sim.scene import Scene, scene
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.starts import with_tasks


class Reseeding:
    """A request, fitted and compiled for one seed after the other."""

    def __init__(self, request: FitRequest) -> None:
        """Fit and compile what all runs have in common. Raises KoordError."""
        self._request = request
        self._first = fit(request)
        bare, self._configuration, _ = configured(request, [])
        self._landmarks = landmarks_of(bare)
        self._unplaced = _unplaced(request, self._first)
        self._places = places_of_tasks(self._first.scene)
        program = self._first.program.core
        self._compiler = StartCompiler(program)
        self._claims = watched(program, slack_of(self._first))

    @property
    def first(self) -> Fitted:
        """The request, fitted with its own seed."""
        return self._first

    @uncollected()
    def run(self, seed: int) -> tuple[Fitted, Built]:
        """The run with a seed: as :func:`fit` and :func:`build` make it.

        Raises KoordError.
        """
        fitted = self._fitted(seed)
        if fitted is None:  # what is wrong with it is told there
            fitted = fit(replace(self._request, seed=seed))
            return fitted, build(fitted)
        classes = self._compiler.classes(fitted.program.core)
        return fitted, Built(cast(fitted, classes, self._claims), self._claims)

    def _fitted(self, seed: int) -> Fitted | None:
        first, request = self._first, self._request
        if seed == first.scene.seed:
            return first
        try:
            placed = scene(
                self._configuration, seed, request.robots, self._landmarks, located=request.located
            )
        except KoordError:
            return None
        program, places = first.program, places_of_tasks(placed)
        if places != self._places:
            if self._unplaced is None or len(places) != len(first.scene.world.tasks):
                return None
            settings = replace(program.settings, tasks=places)
            program = replace(program, core=with_tasks(self._unplaced, places), settings=settings)
        configuration = replace(self._configuration, world=placed.world)
        return replace(first, program=program, configuration=configuration, placed=placed)


def places_of_tasks(placed: Scene) -> core.Places:
    """The places of a scene's tasks in metres, as exact numbers."""
    return tuple((Fraction(x), Fraction(y), Fraction(z)) for x, y, z in placed.world.tasks)


def _unplaced(request: FitRequest, fitted: Fitted) -> core.Program | None:
    """The program before the world's tasks are put into it; None if more hangs on them."""
    settings = fitted.program.settings
    if settings.tasks is None:
        return None
    try:
        bare = elaborated(request, replace(settings, tasks=None)).core
    except KoordError:
        return None
    return bare if with_tasks(bare, settings.tasks) == fitted.program.core else None
