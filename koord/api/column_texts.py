"""Changes of columns in words: for rounds that code made, without their configurations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from msgspec import Struct, field

from koord.semantics.values import identical
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.types import ScalarType
from koord.traces.changes import told_apart
from koord.traces.names import Named, Names

if TYPE_CHECKING:
    from koord.sampling.compiled.round_log import ColumnChange
    from koord.sampling.compiled.state import StateColumn

#: So many texts of a column are remembered.
_MOST_KNOWN = 2_000


class NotPlainError(Exception):
    """Raised for changes that only two configurations can tell."""


class _Texts(Struct):
    """The names of a column by index, in a robot's own row and elsewhere, and known changes."""

    own: list[str]
    elsewhere: list[str]
    known: dict[tuple[Any, Any], str] = field(default_factory=dict)


class ColumnTexts:
    """The changes of variables that hold one scalar for each robot, or one for all."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self._columns: dict[str, _Texts] = {}

    def told(self, changes: Iterable[ColumnChange], of: int | None) -> tuple[str, ...]:
        """Changes in words, each with its robot if that is another one. Raises NotPlainError."""
        told = []
        for column, index, old, new in changes:
            if old is new:
                continue
            texts = self._columns.get(column.name)
            if texts is None:
                texts = self._columns[column.name] = self._texts_of(column)
            try:
                text = texts.known.get((old, new))
            except TypeError:  # what is not set is nothing that a text could be known of
                raise NotPlainError from None
            if text is None:
                text = self._text(column, old, new)
                if len(texts.known) > _MOST_KNOWN:
                    texts.known.clear()
                if not isinstance(old, float):  # of which some are equal and not identical
                    texts.known[old, new] = text
            if text:
                names = texts.own if index == of else texts.elsewhere
                told.append(names[index] + text)
        return tuple(told)

    def _texts_of(self, column: StateColumn) -> _Texts:
        own, elsewhere = [], []
        for index, slot in enumerate(column.slots):
            name = "" if slot is None else self._name(column.home, slot, index)
            own.append(name)
            is_shared = column.home in (Home.ALLREAD, Home.ALLWRITE)
            elsewhere.append(name if is_shared else f"{name}@{index}")
        return _Texts(own, elsewhere)

    def _name(self, home: Home | None, slot: int, index: int) -> str:
        named: Named
        match home:
            case Home.ALLREAD:
                return f"{self._names.allread[slot].name}[{index}]"
            case Home.ALLWRITE:
                named = self._names.allwrite[slot]
            case Home.LOCAL:
                named = self._names.of(index).locals[slot]
            case Home.PORT:
                named = self._names.of(index).ports[slot]
            case _:
                return "status"
        return named.name

    @staticmethod
    def _text(column: StateColumn, old: Any, new: Any) -> str:
        """What is told behind the name; "" if nothing changed."""
        if column.home is None:
            before, after = (Status(status).name.lower() for status in (old, new))
            return f": {before} → {after}" if old != new else ""
        if not isinstance(column.type, ScalarType) or not column.is_set(old, new):
            raise NotPlainError
        one, other = column.shown(old), column.shown(new)
        if identical(one, other):
            return ""
        was, became = told_apart(one, other, column.type)
        return f": {was} → {became}"
