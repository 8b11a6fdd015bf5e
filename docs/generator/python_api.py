"""The page of the Python API, from the signatures and docstrings of the public names."""

from __future__ import annotations

import enum
import inspect
import re
from typing import Any

import koord
from docs.generator.markdown import code, fence, plain, table
from koord.api.field_comments import field_comments

PAGE = "reference/python.md"

_ROLE = re.compile(r":(?:class|func|meth|mod|attr):`~?([\w.]+)`")


def pages() -> dict[str, str]:
    """The page."""
    return {PAGE: _page()}


def public() -> list[str]:
    """The public names that have an entry."""
    return sorted((name for name in koord.__all__ if name != "__version__"), key=str.lower)


def _page() -> str:
    functions = [name for name in public() if not inspect.isclass(getattr(koord, name))]
    classes = [name for name in public() if inspect.isclass(getattr(koord, name))]
    text = (
        "# Python API\n\n"
        "Generated from the docstrings. What the commands do, functions do: typed, with the same "
        "defaults, and with results that are data. Nothing is printed; mistakes are a "
        "[`koord.KoordError`](#koorderror) with all diagnostics. Every result has `to_dict()` and "
        "`to_json()`, in the form of the command's `--json`.\n"
        "\n## Functions\n"
    )
    text += "".join(_function(name) for name in functions)
    text += "\n## Classes\n"
    return text + "".join(_class(name) for name in classes)


def _function(name: str) -> str:
    found = getattr(koord, name)
    shown = fence("python", f"koord.{name}{signature(found)}")
    return f"\n### {name}\n\n{shown}\n{docstring(found)}"


def _class(name: str) -> str:
    found = getattr(koord, name)
    text = f"\n### {name}\n\n{docstring(found)}"
    if issubclass(found, enum.Enum):
        return text + "\n" + ", ".join(code(str(one.value)) for one in found) + "\n"
    rows = [
        (code(field), _prose(said))
        for field, said in (field_comments(found) if _is_struct(found) else {}).items()
        if not field.startswith("_")
    ]
    members = [
        (key, inspect.getattr_static(found, key))
        for key in dir(found)
        if not key.startswith("_") and _is_own(found, key)
    ]
    for key, member in members:
        if isinstance(member, property):
            rows.append((code(key), _first(member.fget)))
    if rows:
        text += "\n" + table(("attribute", "what it is"), rows)
    called = [
        (code(f"{key}{signature(getattr(found, key))}"), _first(getattr(found, key)))
        for key, member in members
        if inspect.isroutine(member) or isinstance(member, classmethod | staticmethod)
    ]
    if called:
        text += "\n" + table(("method", "what it does"), called)
    return text


def _is_struct(found: type) -> bool:
    return hasattr(found, "__struct_fields__")


def _is_own(found: type, key: str) -> bool:
    """Whether koord defines a member: not Python, and not a library."""
    for one in found.__mro__:
        if key in vars(one):
            return one.__module__.startswith("koord")
    return False


def _first(member: Any) -> str:
    """The first paragraph of a docstring."""
    return _prose((inspect.getdoc(member) or "").split("\n\n")[0])


def signature(found: Any) -> str:
    """The parameters and the result of a function, with types as they are written."""
    made = inspect.signature(found)
    parameters = [one for one in made.parameters.values() if one.name not in ("self", "cls")]
    whole = made.replace(parameters=[_plain_default(one) for one in parameters])
    return re.sub(r"'([^']*)'", r"\1", str(whole))


class _Shown:
    """A default, as it is written in a program."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def _plain_default(parameter: inspect.Parameter) -> inspect.Parameter:
    default = parameter.default
    if isinstance(default, enum.Enum):
        return parameter.replace(default=_Shown(repr(default.value).replace("'", '"')))
    if isinstance(default, str):
        return parameter.replace(default=_Shown(f'"{default}"'))
    return parameter


def _prose(text: str) -> str:
    """Prose of a docstring as Markdown: roles and double backquotes become code."""
    text = _ROLE.sub(r"`\1`", text)
    return plain(re.sub(r"``([^`]+)``", r"`\1`", text))


def docstring(found: Any) -> str:
    """A docstring as Markdown: prose, and examples as blocks."""
    text = ""
    for paragraph in (inspect.getdoc(found) or "").split("\n\n"):
        if paragraph.lstrip().startswith(">>>"):
            text += fence("pycon", paragraph) + "\n"
        elif paragraph.startswith("    "):
            text += fence("python", inspect.cleandoc(paragraph)) + "\n"
        elif paragraph:
            text += f"{_prose(paragraph)}\n\n"
    return text
