"""YAML documents with the place of every value."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import yaml
from msgspec import Struct, field

from koord.runtime.configuration.loaders import quick_loader
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Source, Span

#: The way to a value: names of fields and positions in lists.
Path = tuple[str | int, ...]

#: A configuration with more values than this is none; aliases of aliases grow without bound.
MOST_VALUES = 200_000

#: No field of a configuration lies nearly so deep.
_DEEPEST = 50


class Document(Struct):
    """A YAML document: its values, and their places in the file."""

    source: Source
    value: Any
    spans: dict[Path, Span] = field(default_factory=dict)
    names: dict[Path, Span] = field(default_factory=dict)  #: of fields: where the name stands
    words: dict[Path, str] = field(default_factory=dict)  #: what stands there without quotes
    site: Source | None = None  #: another file, some fields of which are from there (P-SITE)
    scenes: tuple[Source, ...] = ()  #: files that say where robots and obstacles are (P-SCENE)

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files that it was read from."""
        more = (self.source, *filter(None, [self.site]), *self.scenes)
        return tuple(dict.fromkeys(more))

    def place(self, path: Path) -> Span:
        """The place of a value, or of the nearest one around it that has one."""
        while path and path not in self.spans:
            path = path[:-1]
        return self.spans.get(path, Span(self.source.name, 1, 1, 1, 1))

    def name_place(self, path: Path) -> Span:
        """The place of a field's name."""
        return self.names.get(path) or self.place(path)


def problem(span: Span, message: str, hint: str | None = None, code: str = "K931") -> Diagnostic:
    """A diagnostic of a configuration."""
    return Diagnostic(code, Severity.ERROR, span, message, hint)


def read(source: Source) -> Document:
    """Parse YAML. Raises KoordError if the text is not YAML, or no mapping."""
    document = read_any(source)
    if not isinstance(document.value, dict):
        raise KoordError((_no_fields(source),))
    return document


def _no_fields(source: Source) -> Diagnostic:
    hint = "a configuration begins with fields such as `agents:` and `devices:`"
    place = Span(source.name, 1, 1, 1, 1)
    return problem(place, "there are no fields in this file", hint, "K930")


def read_any(source: Source) -> Document:
    """Parse YAML, whatever its outermost value is. Raises KoordError if the text is not YAML.

    What is wrong with a text the slow loader says alone, so that all machines say the same.
    """
    quick = quick_loader(source.text)
    if quick is not None:
        with suppress(KoordError):
            return read_by(source, quick)
    return read_by(source, yaml.SafeLoader)


def read_by(source: Source, loader: type[yaml.SafeLoader | yaml.CSafeLoader]) -> Document:
    """Parse YAML by one loader. Raises KoordError."""
    try:
        node = yaml.compose(source.text, Loader=loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
        span = Span(source.name, line, column, line, column + 1)
        raise KoordError((problem(span, f"not YAML: {error.problem}", code="K930"),)) from None
    except (yaml.YAMLError, RecursionError) as error:
        span = Span(source.name, 1, 1, 1, 1)
        story = " ".join(str(error).split())[:200]
        raise KoordError((problem(span, f"not YAML: {story}", code="K930"),)) from None
    if node is None or isinstance(node, yaml.ScalarNode):
        raise KoordError((_no_fields(source),))
    reader = _YamlReader(source)
    value = reader.value(node, ())
    if reader.problems:
        raise KoordError(tuple(reader.problems))
    reader.document.value = value
    return reader.document


def with_site(document: Document, site: Document) -> Document:
    """A document with the fields of another one. Raises KoordError for those of both. (P-SITE)"""
    twice = [
        (site.name_place((k,)), document.name_place((k,)), k)
        for k in site.value
        if k in document.value
    ]
    if twice:
        hint = "leave it out in one of both files"
        raise KoordError(
            tuple(
                problem(here, f"`{name}` is in {there.file} too, in line {there.line}", hint)
                for here, there, name in twice
            )
        )
    return Document(
        document.source,
        document.value | site.value,
        site.spans | document.spans,
        document.names | site.names,
        document.words | site.words,
        site.source,
    )


class _YamlReader:
    def __init__(self, source: Source) -> None:
        self.document = Document(source, None)
        self.problems: list[Diagnostic] = []
        self._scalars = yaml.SafeLoader("")
        self._known: dict[tuple[str, str], Any] = {}  #: scalars by tag and text
        self._values = 0
        self._open: set[int] = set()  #: the nodes that the one that is read stands in

    def value(self, node: yaml.Node, path: Path) -> Any:
        self.document.spans[path] = span = self._span(node)
        self._values += 1
        if self._values > MOST_VALUES:
            raise KoordError((problem(span, "the file has too many values", code="K930"),))
        if isinstance(node, yaml.ScalarNode):
            if not node.style:  # libyaml says "" of plain words
                self.document.words[path] = node.value
            return self._scalar(node, span)
        if id(node) in self._open:
            story, hint = (
                "this contains itself",
                "an alias (`*name`) may stand for what ended before it",
            )
            raise KoordError((problem(span, story, hint, "K930"),))
        if len(path) > _DEEPEST:
            raise KoordError((problem(span, "nested too deep", code="K930"),))
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.MappingNode):
                return self._fields(node, path)
            return [self.value(item, (*path, k)) for k, item in enumerate(node.value)]
        finally:
            self._open.discard(id(node))

    def _fields(self, node: yaml.MappingNode, path: Path) -> dict[Any, Any]:
        fields: dict[Any, Any] = {}
        given: dict[Any, Span] = {}  #: by this mapping itself, not by one that is merged into it
        for name_node, value_node in node.value:
            if name_node.tag == "tag:yaml.org,2002:merge":
                merged = self.value(value_node, path)
                if isinstance(merged, dict):
                    fields = {**merged, **fields}
                continue
            name = self._scalar(name_node, self._span(name_node))
            if not isinstance(name, str | int):
                place = self._span(name_node)
                self.problems.append(problem(place, "the name of a field is a word or a number"))
                continue
            here = (*path, name)
            first = given.get(name)
            if first is not None:
                self.problems.append(
                    problem(
                        self._span(name_node),
                        f"`{name}` is given twice",
                        f"it was given in line {first.line} first",
                    )
                )
            given[name] = self.document.names[here] = self._span(name_node)
            fields[name] = self.value(value_node, here)
        return fields

    def _scalar(self, node: yaml.Node, span: Span) -> Any:
        if isinstance(node, yaml.ScalarNode) and (node.tag, node.value) in self._known:
            return self._known[node.tag, node.value]
        try:
            value = self._scalars.construct_object(node, deep=True)
        except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, ValueError):
            self.problems.append(problem(span, f"`{node.value}` cannot be read", code="K930"))
            return None
        if isinstance(node, yaml.ScalarNode):
            self._known[node.tag, node.value] = value
        return value

    def _span(self, node: yaml.Node) -> Span:
        start, end = node.start_mark, node.end_mark
        line, column = start.line + 1, start.column + 1
        if end.line == start.line:
            return Span(self.document.source.name, line, column, line, end.column + 1)
        text = self.document.source.line_text(line)
        return Span(self.document.source.name, line, column, line, len(text) + 1)
