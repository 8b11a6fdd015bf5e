"""The sections of a file, sorted by kind; repeated ones are merged."""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from msgspec import Struct, field

from koord.syntax import ast
from koord.syntax.elaboration.findings import DiagnosticLog

Stated = ast.Invariant | ast.Eventually | ast.LeadsTo

#: The params that state the instance a program is meant for, and the arguments that choose another.
ARGUMENTS = {"numAgents": "robots=", "Nsys": "robots=", "delta": "delta_s="}


class AgentSections(Struct):
    """The sections of one kind of robot, or of those outside of `agent` blocks, for all kinds."""

    name: str
    declared: ast.Ident | None = None
    locals: list[ast.VarDecl] = field(default_factory=list)
    using: list[ast.Using] = field(default_factory=list)
    init: list[ast.Init] = field(default_factory=list)
    events: list[ast.Event] = field(default_factory=list)
    assumptions: list[ast.Assume] = field(default_factory=list)
    expectations: list[ast.LeadsTo] = field(default_factory=list)
    properties: list[Stated] = field(default_factory=list)
    of_run: list[ast.VarDecl] = field(default_factory=list)  #: params that state the instance


class Sections(Struct):
    """The sections of a whole program, sorted by kind."""

    common: AgentSections = field(default_factory=lambda: AgentSections(""))
    kinds: list[AgentSections] = field(default_factory=list)
    allread: list[ast.VarDecl] = field(default_factory=list)
    allwrite: list[ast.VarDecl] = field(default_factory=list)
    params: list[ast.VarDecl] = field(default_factory=list)
    records: list[ast.RecordDef] = field(default_factory=list)
    enums: list[ast.EnumDef] = field(default_factory=list)
    functions: list[ast.FunDef] = field(default_factory=list)

    @property
    def is_empty(self) -> bool:
        """True if there are no sections."""
        own = (getattr(self, name) for name in self.__struct_fields__ if name != "common")
        return self.common == AgentSections("") and not any(own)

    @property
    def only_properties(self) -> bool:
        """True if this is a file of properties, about a program in another file."""
        common = self.common
        rest = (self.kinds, self.allread, self.allwrite, common.locals, common.using)
        if any(rest) or common.init or common.events:
            return False
        return bool(common.assumptions or common.expectations or common.properties)


def sort(sections: Iterable[ast.Section], findings: DiagnosticLog) -> Sections:
    """Sort the sections of a program by kind."""
    result = Sections()
    for section in sections:
        _place(section, result, result.common, findings)
    return result


def _place(
    section: ast.Section, into: Sections, kind: AgentSections, findings: DiagnosticLog
) -> None:
    if _of_kind(section, kind):
        return
    match section:
        case ast.VarSection(kind=ast.VarKind.ALLREAD, decls=decls):
            into.allread.extend(decls)
        case ast.VarSection(kind=ast.VarKind.ALLWRITE, decls=decls):
            into.allwrite.extend(decls)
        case ast.ParamDecl(decl=decl) if decl.name.name in ARGUMENTS:
            kind.of_run.append(decl)
        case ast.ParamDecl(decl=decl):
            into.params.append(decl)
        case ast.RecordDef():
            into.records.append(section)
        case ast.EnumDef():
            into.enums.append(section)
        case ast.FunDef():
            into.functions.append(section)
        case ast.Agent():
            if kind is not into.common:
                findings.error(
                    "K232",
                    section.span,
                    "an `agent` block stands inside another",
                    "begin it at the left margin",
                )
            _agent(section, into, findings)
        case _:
            raise AssertionError(section)


def _of_kind(section: ast.Section, kind: AgentSections) -> bool:
    match section:
        case ast.VarSection(kind=ast.VarKind.LOCAL, decls=decls):
            kind.locals.extend(decls)
        case ast.Using():
            kind.using.append(section)
        case ast.Init():
            kind.init.append(section)
        case ast.Event():
            kind.events.append(section)
        case ast.Assume():
            kind.assumptions.append(section)
        case ast.LeadsTo(assumed=True):
            kind.expectations.append(section)
        case ast.Invariant() | ast.Eventually() | ast.LeadsTo():
            kind.properties.append(section)
        case (
            ast.VarSection()
            | ast.ParamDecl()
            | ast.RecordDef()
            | ast.EnumDef()
            | ast.FunDef()
            | ast.Agent()
        ):
            return False
        case _:
            assert_never(section)
    return True


def _agent(section: ast.Agent, into: Sections, findings: DiagnosticLog) -> None:
    known = next((kind for kind in into.kinds if kind.name == section.name.name), None)
    kind = known or AgentSections(section.name.name, section.name)
    if known is None:
        into.kinds.append(kind)
    for part in section.sections:
        _place(part, into, kind, findings)
