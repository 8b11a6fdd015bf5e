"""Symbols: what can be declared in a program, as people are told of it."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from functools import lru_cache

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.editing.lines import code_of
from koord.syntax.elaboration.library import LIBRARY, library, library_text
from koord.syntax.source import Source, Span


class SymbolKind(Enum):
    """The kinds of symbols; the value says it to people."""

    LOCAL = "local variable"
    ALLREAD = "allread variable"
    ALLWRITE = "allwrite variable"
    PARAM = "param"
    SENSOR = "sensor"
    ACTUATOR = "actuator"
    RECORD = "record"
    FIELD = "field"
    ENUM = "enumeration"
    MEMBER = "member"
    FUNCTION = "function"
    EXTERNAL = "external function"
    PARAMETER = "parameter"
    BOUND = "bound variable"
    MODULE = "module"
    CONTRACT = "contract"
    EVENT = "event"
    ROBOTS = "kind of robot"
    ASSUMPTION = "assumption"
    INVARIANT = "invariant"
    EVENTUALLY = "liveness property"
    TYPE = "type"
    WORD = "word of the language"


class Symbol(Struct, frozen=True):
    """Something with a name: where it is declared, and how.

    ``name_span`` is None for what the language has itself. ``code`` is the declaration as written,
    ``story`` the comments beside it, ``owner`` the record, module or enumeration it is a part of.
    """

    name: str
    kind: SymbolKind
    code: str
    name_span: Span | None = None
    whole: Span | None = None
    story: str = ""
    owner: str = ""
    children: tuple[Symbol, ...] = ()

    @property
    def in_library(self) -> bool:
        """True if it is declared in the library."""
        return self.name_span is not None and self.name_span.file == LIBRARY


def declared(program: ast.Program, source: Source) -> tuple[Symbol, ...]:
    """The symbols that a text declares, in order, with their parts as children."""
    return tuple(_Declarations(program, source).of(program.sections))


def with_children(symbols: tuple[Symbol, ...]) -> Iterator[Symbol]:
    """Symbols and all their parts."""
    for symbol in symbols:
        yield symbol
        yield from with_children(symbol.children)


@lru_cache(maxsize=1)
def library_symbols() -> tuple[Symbol, ...]:
    """The symbols of the library."""
    text = Source(LIBRARY, library_text())
    known = library()
    functions = [each for same in known.functions.values() for each in same]
    sections: tuple[ast.Section, ...] = (known.task, *functions, *known.modules.values())
    return declared(ast.Program(sections, _library_comments(text)), text)


def _library_comments(text: Source) -> tuple[ast.Comment, ...]:
    found = []
    for number, line in enumerate(text.text.split("\n"), 1):
        before = code_of(line)
        told = line[len(before) :]
        if told:
            found.append(ast.Comment(number, len(before) + 1, told, not before.strip()))
    return tuple(found)


_VARIABLES = {
    ast.VarKind.LOCAL: SymbolKind.LOCAL,
    ast.VarKind.ALLREAD: SymbolKind.ALLREAD,
    ast.VarKind.ALLWRITE: SymbolKind.ALLWRITE,
}


class _Declarations:
    """The declarations of one text."""

    def __init__(self, program: ast.Program, source: Source) -> None:
        self.source = source
        self.comments = {comment.line: comment for comment in program.comments}

    def of(self, sections: tuple[ast.Section, ...]) -> Iterator[Symbol]:
        for section in sections:
            match section:
                case ast.VarSection(kind=kind, decls=decls):
                    yield from (self.variable(decl, _VARIABLES[kind], kind.value) for decl in decls)
                case ast.ParamDecl(decl=decl):
                    yield self.variable(decl, SymbolKind.PARAM, "param")
                case ast.RecordDef(name=name, fields=fields):
                    parts = tuple(self.variable(d, SymbolKind.FIELD, "", name.name) for d in fields)
                    yield self.made(name, SymbolKind.RECORD, section.span, parts)
                case ast.EnumDef(name=name, members=members):
                    parts = tuple(
                        self.made(m, SymbolKind.MEMBER, m.span, owner=name.name) for m in members
                    )
                    yield self.made(name, SymbolKind.ENUM, section.span, parts)
                case ast.FunDef():
                    yield self.function(section)
                case ast.Using():
                    yield self.module(section)
                case ast.Event(name=name):
                    yield self.made(name, SymbolKind.EVENT, section.span)
                case ast.Agent(name=name, sections=inner):
                    parts = tuple(self.of(inner))
                    yield self.made(name, SymbolKind.ROBOTS, section.span, parts)
                case ast.Assume(name=ast.Ident() as name):
                    yield self.made(name, SymbolKind.ASSUMPTION, name.span.to(section.span))
                case ast.LeadsTo(name=ast.Ident() as name, assumed=True):
                    yield self.made(name, SymbolKind.ASSUMPTION, name.span.to(section.span))
                case ast.Invariant(name=ast.Ident() as name):
                    yield self.made(name, SymbolKind.INVARIANT, section.span)
                case (
                    ast.Eventually(name=ast.Ident() as name) | ast.LeadsTo(name=ast.Ident() as name)
                ):
                    yield self.made(name, SymbolKind.EVENTUALLY, section.span)
                case _:
                    pass

    def variable(self, decl: ast.VarDecl, kind: SymbolKind, word: str, owner: str = "") -> Symbol:
        code = " ".join(self.slice(decl.span).split())
        return Symbol(
            decl.name.name,
            kind,
            f"{word} {code}".strip(),
            decl.name.span,
            decl.span,
            "" if kind is SymbolKind.PARAMETER else self.story(decl.span),
            owner,
        )

    def function(self, section: ast.FunDef) -> Symbol:
        external = isinstance(section.body, ast.External)
        kind = SymbolKind.EXTERNAL if external else SymbolKind.FUNCTION
        parts = tuple(self.variable(d, SymbolKind.PARAMETER, "") for d in section.parameters)
        return self.made(section.name, kind, section.span, parts, whole=external)

    def module(self, section: ast.Using) -> Symbol:
        name = section.module.name
        parts = (
            *(self.variable(d, SymbolKind.SENSOR, "sensor", name) for d in section.sensors),
            *(self.variable(d, SymbolKind.ACTUATOR, "actuator", name) for d in section.actuators),
            *(
                self.made(c.name, SymbolKind.CONTRACT, c.span, owner=name, whole=True)
                for c in section.contracts
            ),
        )
        return self.made(section.module, SymbolKind.MODULE, section.span, parts)

    def made(
        self,
        name: ast.Ident,
        kind: SymbolKind,
        span: Span,
        children: tuple[Symbol, ...] = (),
        *,
        owner: str = "",
        whole: bool = False,
    ) -> Symbol:
        """A symbol of several lines, of which the first one is shown, or the ``whole``."""
        code = self.slice(span) if whole else self.slice(span).split("\n")[0]
        code = code if whole else code[: len(code_of(code))]
        if kind is SymbolKind.ASSUMPTION:
            code = f"assume {code}"
        return Symbol(
            name.name,
            kind,
            code.rstrip().rstrip(":"),
            name.span,
            span,
            self.story(span),
            owner,
            children,
        )

    def slice(self, span: Span) -> str:
        """The text of a place, its lines indented from the left margin."""
        start = self.source.offset(span.line, span.column)
        end = self.source.offset(span.end_line, span.end_column)
        first, *others = self.source.text[start:end].split("\n")
        margin = span.column - 1
        return "\n".join([first, *(line[margin:] for line in others)])

    def story(self, span: Span) -> str:
        """The comment behind a declaration's first line, or those right above it."""
        behind = self.comments.get(span.line)
        if behind is not None and not behind.own_line:
            return _told(behind)
        lines: list[str] = []
        line = span.line - 1
        while line in self.comments and self.comments[line].own_line:
            lines.append(_told(self.comments[line]))
            line -= 1
        return "\n".join(reversed(lines)).strip("- \n")


def _told(comment: ast.Comment) -> str:
    return comment.text.lstrip("#/").strip()
