"""Reading JSON that anybody may have written: every surprise is a diagnostic with its path."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from enum import Enum
from typing import TypeVar

from msgspec import Struct

from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import Span

#: What every refusal of a damaged file advises, unless something better is known.
WRITE_ANEW = "the file was changed or damaged; write the trace anew"

M = TypeVar("M", bound=Enum)


class Reader(Struct, frozen=True):
    """A part of a JSON document: its value and where it stands (``$.rounds[3].order``)."""

    value: object
    path: str
    file: str

    def refuse(self, message: str, code: str = "K913", hint: str = WRITE_ANEW) -> KoordError:
        """What is wrong here."""
        return refusal(code, self.file, f"{self.path}: {message}", hint)

    # --- structure ------------------------------------------------------------------------------

    def fields(
        self, required: Collection[str], optional: Collection[str] = ()
    ) -> dict[str, Reader]:
        """The fields of an object that has all the required ones, and no strange ones."""
        found = dict(self.entries())
        for name in required:
            if name not in found:
                raise self.refuse(f"the field {name!r} is missing")
        for name in found:
            if name not in required and name not in optional:
                raise found[name].refuse("there should be no such field")
        return found

    def entries(self) -> Iterator[tuple[str, Reader]]:
        """The fields of an object, whatever they are called."""
        if not isinstance(self.value, dict):
            raise self.refuse(f"there should be an object here, not {described(self.value)}")
        for name, value in self.value.items():
            yield name, Reader(value, f"{self.path}.{shortened(name)}", self.file)

    def items(self, count: int | None = None) -> list[Reader]:
        """The elements of an array, of ``count`` elements if that is given."""
        if not isinstance(self.value, list):
            raise self.refuse(f"there should be an array here, not {described(self.value)}")
        if count is not None and len(self.value) != count:
            raise self.refuse(f"there should be {count} elements here, not {len(self.value)}")
        return [
            Reader(value, f"{self.path}[{position}]", self.file)
            for position, value in enumerate(self.value)
        ]

    # --- scalars --------------------------------------------------------------------------------

    def text(self) -> str:
        if not isinstance(self.value, str):
            raise self.refuse(f"there should be a string here, not {described(self.value)}")
        return self.value

    def boolean(self) -> bool:
        if not isinstance(self.value, bool):
            raise self.refuse(f"there should be true or false here, not {described(self.value)}")
        return self.value

    def integer(self, least: int | None = None, below: int | None = None) -> int:
        """An integer from ``least`` up to and excluding ``below``, as far as these are given."""
        value = self.value
        if not isinstance(value, int) or isinstance(value, bool):
            raise self.refuse(f"there should be an integer here, not {described(value)}")
        if (least is not None and value < least) or (below is not None and value >= below):
            raise self.refuse(f"{value} is out of range")
        return value

    def member(self, enumeration: type[M]) -> M:
        """A member of an enumeration, by its value."""
        text = self.text()
        for candidate in enumeration:
            if candidate.value == text:
                return candidate
        known = ", ".join(repr(candidate.value) for candidate in enumeration)
        raise self.refuse(f"{shortened(text)!r} is none of {known}")


def described(value: object) -> str:
    """A JSON value in a message: what it is, or itself where it is short."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case dict():
            return "an object"
        case list():
            return "an array"
        case _:
            return shortened(repr(value))


def shortened(text: str, most: int = 40) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


class _FormError(ValueError):
    """JSON that Python accepts, and nobody should."""


def parse(raw: bytes, file: str) -> Reader:
    """A JSON document. Raises KoordError."""
    try:
        text = raw.decode("utf-8-sig")
        document = json.loads(text, object_pairs_hook=_distinct, parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        raise refusal("K910", file, f"byte {error.start} is not UTF-8", NO_JSON) from None
    except json.JSONDecodeError as error:
        raise _not_json(file, text, error) from None
    except RecursionError:
        raise refusal("K910", file, "it is nested too deeply", NO_JSON) from None
    except _FormError as error:
        raise refusal("K910", file, str(error), NO_JSON) from None
    except ValueError:  # Python converts no longer ones
        raise refusal("K910", file, "a number in it has thousands of digits", NO_JSON) from None
    return Reader(document, "$", file)


NO_JSON = "name a file that `koord run --trace` or `koord verify --trace` wrote"


def _not_json(file: str, text: str, error: json.JSONDecodeError) -> KoordError:
    if not text.strip():
        return refusal("K910", file, "the file is empty", NO_JSON)
    if not text[error.pos :].strip():
        message, hint = "it ends in the middle: the file is cut off", "write the trace anew"
    else:
        message, hint = f"it is no JSON: {error.msg[:1].lower()}{error.msg[1:]}", NO_JSON
    place = Span(file, error.lineno, error.colno, error.lineno, error.colno + 1)
    return refusal("K910", place, message, hint)


def _distinct(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _FormError(f"an object has the field {shortened(twice)!r} twice")
    return found


def _no_constant(name: str) -> object:
    raise _FormError(f"{name} is no JSON")
