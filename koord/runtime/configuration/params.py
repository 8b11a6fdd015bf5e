"""The values that a configuration gives params."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

from koord.runtime.configuration.model import Configuration
from koord.runtime.configuration.reading import problem
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaborate.settings import ParamValue


def params(configuration: Configuration) -> dict[str, ParamValue]:
    """The values that a configuration gives params. Raises KoordError for what is no value."""
    return {
        name: _value(configuration, value, ("params", name))
        for name, value in configuration.params.items()
    }


def _value(configuration: Configuration, value: Any, path: tuple[str | int, ...]) -> ParamValue:
    match value:
        case bool() | int() | str():
            return value
        case float() if math.isfinite(value):
            return Fraction(repr(value))
        case list():
            return tuple(_value(configuration, v, (*path, k)) for k, v in enumerate(value))
        case _:
            hint = "a param is a number, a truth value, a text or a list of them"
            span = configuration.place(*path)
            raise KoordError((problem(span, "this is no value of a param", hint),))
