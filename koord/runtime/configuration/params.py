"""The values that a configuration gives params: numbers are read as ``--set`` reads them."""

from __future__ import annotations

from typing import Any

from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.configuration.reading import problem
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.settings import ParamValue
from koord.syntax.literals import NumberOutOfRangeError, is_number, read_number


def params(configuration: RunConfiguration) -> dict[str, ParamValue]:
    """The values that a configuration gives params. Raises KoordError for what is no value."""
    return {
        name: _value(configuration, value, ("params", name))
        for name, value in configuration.params.items()
    }


def _value(configuration: RunConfiguration, value: Any, path: tuple[str | int, ...]) -> ParamValue:
    word = configuration.word(*path)
    if isinstance(value, list):
        return tuple(_value(configuration, v, (*path, k)) for k, v in enumerate(value))
    if isinstance(value, bool) or (isinstance(value, str) and not is_number(word or "")):
        return value
    # YAML would round it to a double, to 0 for one, and does not see that 1e300 is a number.
    number, story = None, "this is no value of a param"
    try:
        number = None if word is None else read_number(word)
    except NumberOutOfRangeError as error:
        story = str(error)
    if number is None:
        hint = "a param is a number, a truth value, a text or a list of them"
        raise KoordError((problem(configuration.place(*path), story, hint),))
    return number
