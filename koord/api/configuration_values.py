"""The values that could stand at a place of a configuration: words of schemas, and known names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from msgspec import Struct

from koord.api.configuration_cursor import Cursor, names_under, words_under
from koord.api.configuration_forms import forms_at, values_of, words
from koord.api.drivers import localiser_registry, registry
from koord.api.editing import Symbol, SymbolKind, document
from koord.runtime.configuration.model import MotionAutomaton
from koord.runtime.drivers.registry import CONTROLLERS, MODULES, PLANNERS, Group
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.plugins.names import plug_ins
from koord.syntax.source import Source

#: The vehicle of a device that does not say which it is.
_USUAL = "CAR"


class ConfigurationValue(Struct, frozen=True):
    """A value of a field, and what it is."""

    text: str
    detail: str = ""


class Asked(Struct, frozen=True):
    """What a value is asked about: the place, the text, and the program of the configuration."""

    cursor: Cursor
    source: Source
    program: Source | None


def values_at(asked: Asked) -> tuple[ConfigurationValue, ...]:
    """The values that are known of the field that the cursor is in."""
    if not asked.cursor.path:
        return ()
    *around, name = asked.cursor.path
    here = forms_at(around)
    found = {word: "" for value in values_of(here, name) for word in words(value)}
    if around[-1:] == ["modules"]:
        found.update(_plug_ins(MODULES))
    for form in here:
        names = _NAMES.get((form.get("title", ""), name))
        if names is not None:
            found.update(names(asked))
    return tuple(ConfigurationValue(word, detail) for word, detail in found.items())


def declared(program: Source | None, kind: SymbolKind) -> list[Symbol]:
    """What a program declares of a kind; it may have mistakes."""
    symbols = () if program is None else document(program).symbols
    return [one for one in symbols if one.kind is kind]


#: Names, and what they are.
_Names = Iterable[tuple[str, str]]


def _plug_ins(group: Group[Any]) -> _Names:
    return [(name, "plug-in") for name in plug_ins(group).names]


def _planners(asked: Asked) -> _Names:
    """The planners of the device's vehicle."""
    vehicle = VEHICLES.get(asked.cursor.beside.get("bot_type", _USUAL))
    suitable = tuple(PlannerName) if vehicle is None else vehicle.planners
    return [*((one.value, "planner") for one in suitable), *_plug_ins(PLANNERS)]


def _planners_of_all(asked: Asked) -> _Names:
    """The planners of a block that does not say for which vehicle it is."""
    return [*((one.value, "planner") for one in PlannerName), *_plug_ins(PLANNERS)]


def _automata(asked: Asked) -> _Names:
    return [(one.value, "motion automaton") for one in MotionAutomaton]


def _devices(asked: Asked) -> Iterator[tuple[str, str]]:
    """The devices by their names, of the text without the line of the cursor.

    There the text may be half written, and hide what comes behind.
    """
    lines = asked.source.text.split("\n")
    text = "\n".join(lines[: asked.cursor.span.line - 1] + lines[asked.cursor.span.line :])
    for of in ("devices", "bots"):
        for name in (*names_under(text, of), *words_under(text, of, "bot_name")):
            yield name, "device"


def _kinds(asked: Asked) -> _Names:
    return [(one.name, one.kind.value) for one in declared(asked.program, SymbolKind.ROBOTS)]


def _drivers(asked: Asked) -> _Names:
    return [(name, "driver") for name in registry().names]


def _localisers(asked: Asked) -> _Names:
    return [(name, "localiser") for name in localiser_registry().names]


def _localisers_of_device(asked: Asked) -> _Names:
    return [*_localisers(asked), ("own", "its driver says where it is")]


#: The names that no schema lists, by form and field.
_NAMES: Mapping[tuple[str, str], Callable[[Asked], _Names]] = {
    ("Agent", "kind"): _kinds,
    ("Agent", "motion_automaton"): _automata,
    ("Agent", "on_device"): _devices,
    ("Device", "controller"): lambda asked: _plug_ins(CONTROLLERS),
    ("Device", "driver"): _drivers,
    ("Device", "localiser"): _localisers_of_device,
    ("Device", "motion_automata"): _automata,
    ("Device", "planner"): _planners,
    ("Form", "localiser"): _localisers,
    ("Motion", "motion_automata"): _automata,
    ("Motion", "planner"): _planners_of_all,
}
