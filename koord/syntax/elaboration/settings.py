"""The settings and the result of elaboration."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.literals import ParamValue as ParamValue
from koord.syntax.source import Span


class Settings(Struct, frozen=True):
    """The settings of an elaboration.

    ``params`` replaces the values of ``param`` declarations. ``tasks`` are the places of the
    world's tasks in metres, if the configuration lists them: an ``allwrite`` list of tasks without
    an initial value starts with them. ``places`` is where values stand that no flag gives.
    """

    params: Mapping[str, ParamValue] = field(default_factory=dict)
    tasks: core.Places | None = None
    places: Mapping[str, Span] = field(default_factory=dict)


class Elaborated(Struct, frozen=True):
    """The result of elaboration: a core program, unless there are errors or only properties."""

    program: core.Program | None
    diagnostics: tuple[Diagnostic, ...]
