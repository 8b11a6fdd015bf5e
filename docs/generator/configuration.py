"""The pages of configurations and of the options of drivers, from their forms."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import msgspec

from docs.generator.markdown import plain
from docs.generator.schemas import sections
from koord.api.drivers import OWN, OWN_LOCALISERS
from koord.api.field_comments import field_comments
from koord.runtime.configuration import forms

PAGE = "reference/configuration.md"
DRIVERS = "reference/drivers.md"


def pages() -> dict[str, str]:
    """The two pages."""
    return {PAGE: _page(), DRIVERS: _drivers()}


def _page() -> str:
    def said(name: str, field: str) -> str:
        found = getattr(forms, name, None)
        return field_comments(found).get(field, "") if inspect.isclass(found) else ""

    return (
        "# Configuration files\n\n"
        "Generated from the forms by which configurations are read. A configuration is a YAML "
        "file; `koord sim` and `koord deploy` take it behind the program. `koord config check` "
        "checks it, and `koord schema` prints its JSON Schema, by which editors complete and "
        "check.\n" + sections(forms.json_schema(), said)
    )


def options(target: str) -> type[msgspec.Struct]:
    """The form of the options of a driver or a localiser."""
    module, _, name = target.partition(":")
    driver = getattr(import_module(module), name)
    found: type[msgspec.Struct] = driver.OPTIONS
    return found


def _drivers() -> str:
    text = (
        "# Drivers and localisers\n\n"
        "Generated from the forms of their options. `driver:` of a device names its driver, "
        "`localiser:` what says where it is; options stand under `options:` and "
        "`localiser_options:`. `koord drivers` lists what is installed, those of other packages "
        "as well, and [a lab can bring its own](../specs/platforms/OWN_HARDWARE.md).\n"
    )
    return text + _kind("driver", OWN) + _kind("localiser", OWN_LOCALISERS)


def _kind(noun: str, targets: Mapping[str, str]) -> str:
    text = ""
    for name, target in targets.items():
        form = options(target)
        about = _about(target)
        text += f"\n## {noun.capitalize()} {name}\n\n{plain(about)}\n"
        if not form.__struct_fields__:
            text += "\nIt has no options.\n"
            continue
        text += _options(form)
    return text


def _about(target: str) -> str:
    """The first paragraph of the docstring of what drives."""
    module, _, name = target.partition(":")
    found = getattr(import_module(module), name)
    told = (inspect.getdoc(found if inspect.isclass(found) else type(found)) or "").split("\n\n")
    return told[0]


def _options(form: type[msgspec.Struct]) -> str:
    schema: dict[str, Any] = msgspec.json.schema(form)
    definitions: Mapping[str, Any] = schema["$defs"]
    comments = field_comments(form)
    own = definitions[form.__name__]
    inner = sections(
        {"properties": own["properties"], "required": own.get("required", [])},
        lambda _, field: comments.get(field, ""),
    )
    return _unlinked(inner)


def _unlinked(text: str) -> str:
    """The tables of options name inner forms without a link: they have no section of their own."""
    return re.sub(r"\[(\w+)\]\(#[\w-]+\)", r"\1", text)
