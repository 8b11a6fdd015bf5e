"""Conversion of documents to forms of configurations, with a diagnostic for every mistake."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any, get_type_hints

import msgspec

from koord.runtime.configuration.forms import Agent, Agreement, Carrier, Device, Form
from koord.runtime.configuration.reading import Document, Path, problem
from koord.runtime.guardian.limits import DeadMan, EstopAction
from koord.runtime.motion.bodies import VEHICLES, Level, Steering
from koord.syntax.diagnostics import Diagnostic

#: How msgspec says where: ``$.agents[0].pid``, with ``[...]`` for an unnamed entry of a mapping.
_WHERE = re.compile(r" - at `(key in )?\$([^`]*)`$")
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_UNKNOWN = re.compile(r"Object contains unknown field `([^`]*)`")
_CHOICES: Mapping[str, Iterable[str]] = {
    "agreement": [one.value for one in Agreement],
    "transport": [one.value for one in Carrier],
    "dead_man": [one.value for one in DeadMan],
    "estop": [one.value for one in EstopAction],
    "level": [one.value for one in Level],
    "steering": [one.value for one in Steering],
}
_MISSING = re.compile(r"Object missing required field `([^`]*)`")

#: msgspec works out what a type is when it is first asked; two threads that did so at once have
#: ended a process.
_CONVERTING = threading.Lock()


class FormReader:
    """A document that is converted, and the mistakes that were found in it."""

    def __init__(self, document: Document) -> None:
        self.problems: list[Diagnostic] = []
        self._document = document

    def form(self) -> Form:
        """Convert fields to the types that they should have, each by itself."""
        hints = get_type_hints(Form, include_extras=True)
        good: dict[str, Any] = {}
        for name, value in self._document.value.items():
            path: Path = (name,)
            if name not in hints:
                self._unknown(path, str(name), list(hints))
            elif name == "agents" and isinstance(value, list):
                good[name] = [self._typed(a, Agent, (*path, k)) for k, a in enumerate(value)]
            elif name in ("devices", "bots") and isinstance(value, dict):
                good[name] = {d: self._typed_device(v, (*path, d)) for d, v in value.items()}
            elif name in ("devices", "bots") and isinstance(value, list):
                good[name] = [self._typed_device(v, (*path, k)) for k, v in enumerate(value)]
            elif name == "device":
                good[name] = self._typed_device(value, path)
            else:
                good[name] = self._typed(value, hints[name], path)
        return Form() if self.problems else Form(**good)

    def converted(self, value: Any, type_: Any, path: Path) -> Any:
        """Convert one value; None if it has a mistake, which is added to the problems."""
        return self._typed(value, type_, path)

    def _typed(self, value: Any, type_: Any, path: Path) -> Any:
        try:
            with _CONVERTING:
                return msgspec.convert(value, type_)
        except msgspec.ValidationError as error:
            self._explain(str(error), type_, path)
            return None

    def _typed_device(self, value: Any, path: Path) -> Device | None:
        device: Device | None = self._typed(value, Device, path)
        if device is not None and device.bot_type not in VEHICLES:
            hint = f"it is one of {', '.join(VEHICLES)}"
            self._say((*path, "bot_type"), f"invalid enum value {device.bot_type!r}", hint)
        elif device is not None:
            levels, level = VEHICLES[device.bot_type].levels, device.simulation.level
            if level not in levels:
                hint = f"it has {', '.join(one.value for one in levels)}"
                story = f"a {device.bot_type} has no level {level.value}"
                self._say((*path, "simulation", "level"), story, hint)
        return device

    def _explain(self, message: str, type_: Any, path: Path) -> None:
        found = _WHERE.search(message)
        if found is not None:
            message = message[: found.start()]
            for name, position in _STEP.findall(found[2]):
                if name:
                    path = (*path, name)
                elif position != "...":
                    path = (*path, int(position))
        if unknown := _UNKNOWN.search(message):
            self._unknown((*path, unknown[1]), unknown[1], _names_at(type_, path))
        elif missing := _MISSING.search(message):
            self._say(path, f"`{missing[1]}` is missing")
        else:
            choices = _CHOICES.get(str(path[-1])) if "enum" in message else None
            hint = None if choices is None else f"it is one of {', '.join(choices)}"
            message = message.replace(" | null", "")  # to leave it out is to leave it out
            self._say(path, message[0].lower() + message[1:], hint)

    def _unknown(self, path: Path, name: str, known: list[str]) -> None:
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(sorted(known))}"
        place = self._document.name_place(path)
        self.problems.append(problem(place, f"there is no field `{name}` here", hint))

    def _say(self, path: Path, message: str, hint: str | None = None) -> None:
        self.problems.append(problem(self._document.place(path), message, hint))


def _names_at(type_: Any, path: Path) -> list[str]:
    """The fields of the form at a path; each form has its own names."""
    form = type_
    for step in path[1:]:
        hints: Mapping[str, Any] = get_type_hints(form) if _is_form(form) else {}
        inner = hints.get(str(step))
        for candidate in (inner, *getattr(inner, "__args__", ())):
            if _is_form(candidate):
                form = candidate
    for candidate in (form, *getattr(form, "__args__", ())):
        if _is_form(candidate):
            return list(candidate.__struct_fields__)
    return []


def _is_form(type_: Any) -> bool:
    return isinstance(type_, type) and issubclass(type_, msgspec.Struct)
