"""A reader of untrusted JSON: every error is a diagnostic with the path in the document."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any, TypeVar

from msgspec import Struct, ValidationError, convert

from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import Span

if TYPE_CHECKING:
    import json

#: What every refusal of a damaged file advises, unless something better is known.
WRITE_ANEW = "the file was changed or damaged; write the trace anew"
_HINTS = {"K915": "undo the change, or name the program behind `program=`"}

F = TypeVar("F", bound=Struct)


class FormError(Exception):
    """Raised where a part of a document does not have the required form.

    ``path`` leads to it (``.rounds[3].order``): from ``part``, a struct that was made of an object
    of the document, or else from the document itself.
    """

    def __init__(
        self, message: str, path: str, code: str = "K913", part: Struct | None = None
    ) -> None:
        super().__init__(message)
        self.message, self.path, self.code, self.part = message, path, code, part

    def refusal(
        self, file: str | Span, path: str, form: Struct | None = None, hint: str = WRITE_ANEW
    ) -> KoordError:
        """Make the KoordError for users: ``path`` is where the document stands in the file."""
        path += "" if self.part is None else next(_paths(form, self.part))
        hint = _HINTS.get(self.code, hint)
        return refusal(self.code, file, f"{path}{self.path}: {self.message}", hint)


def _paths(whole: object, part: Struct) -> Iterator[str]:
    """Yield the paths that lead to a struct inside another."""
    match whole:
        case Struct():
            if whole is part:
                yield ""
            for name in whole.__struct_fields__:
                yield from (f".{name}{path}" for path in _paths(getattr(whole, name), part))
        case list():
            for position, item in enumerate(whole):
                yield from (f"[{position}]{path}" for path in _paths(item, part))
        case _:
            pass


class JsonNode(Struct, frozen=True):
    """A part of a JSON document: its value and the path to it."""

    value: object
    path: str = ""

    def refuse(self, message: str, code: str = "K913") -> FormError:
        """Make a FormError about this part of the document."""
        return FormError(message, self.path, code)

    def form(self, form: type[F]) -> F:
        """Convert this object to a struct. Raises FormError."""
        try:
            return convert(self.value, form)
        except ValidationError as error:
            raise self._wrong(str(error)) from None
        except UnicodeEncodeError:  # a name or a word of an enumeration
            raise self.refuse("a word in it holds half a character") from None

    def _wrong(self, text: str) -> FormError:
        """Make a FormError from a message of msgspec, in terms of JSON."""
        said = re.fullmatch(_SAID, text)
        assert said is not None
        message, path = said[1], said[2] or ""
        strange = re.fullmatch(_STRANGE, message)
        if strange:
            name = shortened(strange[1])
            return FormError("there should be no such field", f"{self.path}{path}.{name}")
        found: Any = self.value
        for name, position in re.findall(_STEP, path):
            found = found[int(position)] if position else found[name]
        missing = re.match(_MISSING, message)
        if missing:
            message = f"the field {missing[1]!r} is missing"
        elif isinstance(found, list) and "length" in message:
            length = message.partition("length ")[2].partition(",")[0].replace(">=", "at least")
            message = f"there should be {length} elements here, not {len(found)}"
        elif " >= " in message:
            message = f"{described(found)} is out of range"
        else:
            wanted = re.match(_WANTED, message)
            kinds = wanted[1].split(" | ") if wanted else ()
            names = " or ".join(_KINDS.get(kind, kind) for kind in kinds)
            message = f"there should be {names or 'another word'} here, not {described(found)}"
        return FormError(message, self.path + path)

    # --- structure ------------------------------------------------------------------------------

    def fields(self, names: Collection[str]) -> dict[str, JsonNode]:
        """The fields of an object, which has to have exactly these. Raises FormError."""
        found = dict(self.entries())
        for name in names:
            if name not in found:
                raise self.refuse(f"the field {name!r} is missing")
        for name in found:
            if name not in names:
                raise found[name].refuse("there should be no such field")
        return found

    def entries(self) -> Iterator[tuple[str, JsonNode]]:
        """The fields of an object, with any names. Raises FormError."""
        if not isinstance(self.value, dict):
            raise self.refuse(f"there should be an object here, not {described(self.value)}")
        for name, value in self.value.items():
            yield name, JsonNode(value, f"{self.path}.{shortened(name)}")

    def items(self, count: int | None = None) -> list[JsonNode]:
        """The elements of an array, exactly ``count`` if given. Raises FormError."""
        if not isinstance(self.value, list):
            raise self.refuse(f"there should be an array here, not {described(self.value)}")
        if count is not None and len(self.value) != count:
            raise self.refuse(f"there should be {count} elements here, not {len(self.value)}")
        return [JsonNode(value, f"{self.path}[{k}]") for k, value in enumerate(self.value)]

    # --- scalars --------------------------------------------------------------------------------

    def text(self) -> str:
        if not isinstance(self.value, str):
            raise self.refuse(f"there should be a string here, not {described(self.value)}")
        return self.value

    def boolean(self) -> bool:
        if not isinstance(self.value, bool):
            raise self.refuse(f"there should be true or false here, not {described(self.value)}")
        return self.value

    def integer(self) -> int:
        if not isinstance(self.value, int) or isinstance(self.value, bool):
            raise self.refuse(f"there should be an integer here, not {described(self.value)}")
        return self.value


# Patterns are compiled when they are first needed: most files are in order.
_SAID = r"(?s:(.*?)(?: - at `\$((?:\.\w+|\[\d+\])*)`)?)"
_STEP = r"\.(\w+)|\[(\d+)\]"
_STRANGE = "(?s:Object contains unknown field `(.*)`)"
_MISSING = "Object missing required field `(.*)`"
_WANTED = "Expected `([^`]*)`"
_KINDS = {
    "array": "an array",
    "bool": "true or false",
    "int": "an integer",
    "object": "an object",
    "str": "a string",
}


def described(value: object) -> str:
    """Describe a JSON value in a message: by its type, or as it is where it is short."""
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
    """Raised for JSON that Python accepts but the standard does not."""


def parse(raw: bytes, file: str) -> Any:
    """Parse a JSON document. Raises KoordError."""
    import json  # traces are written more often than they are read

    try:
        text = raw.decode("utf-8-sig")
        return json.loads(text, object_pairs_hook=_distinct, parse_constant=_no_constant)
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
