"""What the protocol asks about a document, answered in its types. Nothing here waits or keeps."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lsprotocol import types

from koord.api.configuration_texts import CheckedText
from koord.api.documents import codes
from koord.api.documents import format as formatted
from koord.api.editing import (
    Completion,
    Diagnostic,
    Document,
    KoordError,
    SemanticToken,
    Severity,
    Source,
    Span,
    Symbol,
    SymbolKind,
    TokenKind,
    TokenModifier,
    is_whole_file,
)
from koord.lsp.places import Places

TOKEN_KINDS = [kind.value for kind in TokenKind]
TOKEN_MODIFIERS = [modifier.value for modifier in TokenModifier]
SOURCE = "koord"

_COMPLETION_KINDS = {
    SymbolKind.LOCAL: types.CompletionItemKind.Variable,
    SymbolKind.ALLREAD: types.CompletionItemKind.Variable,
    SymbolKind.ALLWRITE: types.CompletionItemKind.Variable,
    SymbolKind.PARAM: types.CompletionItemKind.Constant,
    SymbolKind.SENSOR: types.CompletionItemKind.Property,
    SymbolKind.ACTUATOR: types.CompletionItemKind.Property,
    SymbolKind.RECORD: types.CompletionItemKind.Struct,
    SymbolKind.FIELD: types.CompletionItemKind.Field,
    SymbolKind.ENUM: types.CompletionItemKind.Enum,
    SymbolKind.MEMBER: types.CompletionItemKind.EnumMember,
    SymbolKind.FUNCTION: types.CompletionItemKind.Function,
    SymbolKind.EXTERNAL: types.CompletionItemKind.Function,
    SymbolKind.PARAMETER: types.CompletionItemKind.Variable,
    SymbolKind.BOUND: types.CompletionItemKind.Variable,
    SymbolKind.MODULE: types.CompletionItemKind.Module,
    SymbolKind.CONTRACT: types.CompletionItemKind.Interface,
    SymbolKind.EVENT: types.CompletionItemKind.Event,
    SymbolKind.ROBOTS: types.CompletionItemKind.Class,
    SymbolKind.ASSUMPTION: types.CompletionItemKind.Interface,
    SymbolKind.INVARIANT: types.CompletionItemKind.Interface,
    SymbolKind.EVENTUALLY: types.CompletionItemKind.Interface,
    SymbolKind.TYPE: types.CompletionItemKind.TypeParameter,
    SymbolKind.WORD: types.CompletionItemKind.Keyword,
}

_SYMBOL_KINDS = {
    SymbolKind.PARAM: types.SymbolKind.Constant,
    SymbolKind.SENSOR: types.SymbolKind.Property,
    SymbolKind.ACTUATOR: types.SymbolKind.Property,
    SymbolKind.RECORD: types.SymbolKind.Struct,
    SymbolKind.FIELD: types.SymbolKind.Field,
    SymbolKind.ENUM: types.SymbolKind.Enum,
    SymbolKind.MEMBER: types.SymbolKind.EnumMember,
    SymbolKind.FUNCTION: types.SymbolKind.Function,
    SymbolKind.EXTERNAL: types.SymbolKind.Function,
    SymbolKind.MODULE: types.SymbolKind.Module,
    SymbolKind.CONTRACT: types.SymbolKind.Interface,
    SymbolKind.EVENT: types.SymbolKind.Event,
    SymbolKind.ROBOTS: types.SymbolKind.Class,
    SymbolKind.ASSUMPTION: types.SymbolKind.Interface,
    SymbolKind.INVARIANT: types.SymbolKind.Boolean,
    SymbolKind.EVENTUALLY: types.SymbolKind.Boolean,
}


def diagnostics(
    document: Document | CheckedText, places: Places, uri: str
) -> list[types.Diagnostic]:
    """What is wrong with the text; mistakes in other files of the program stand at its top."""
    return [
        _diagnostic(found, places, uri)
        for found in document.diagnostics
        if found.severity is Severity.ERROR or found.span.file == places.source.name
    ]


def _diagnostic(found: Diagnostic, places: Places, uri: str) -> types.Diagnostic:
    message = found.message if found.hint is None else f"{found.message}\nhelp: {found.hint}"
    here = found.span.file == places.source.name
    own = here and not is_whole_file(found.span)
    if not here and places.of(found.span.file) is not None:
        message = f"{found.span}: {message}"
    related = [
        types.DiagnosticRelatedInformation(
            types.Location(uri, places.range(note.span)), note.message
        )
        for note in found.notes
        if note.span.file == places.source.name
    ]
    return types.Diagnostic(
        range=places.range(found.span) if own else types.Range(_START, _START),
        message=message,
        severity=(
            types.DiagnosticSeverity.Error
            if found.severity is Severity.ERROR
            else types.DiagnosticSeverity.Warning
        ),
        code=found.code,
        source=SOURCE,
        related_information=related or None,
        tags=[types.DiagnosticTag.Deprecated] if found.code == "K407" else None,
    )


_START = types.Position(0, 0)


def hover(document: Document, places: Places, position: types.Position) -> types.Hover | None:
    """What is told about a place: what stands there, and the story of what is wrong with it."""
    line, column = places.line_and_column(position)
    found = document.hover(line, column)
    parts = [] if found is None else [found.markdown]
    for wrong in document.diagnostics:
        if _covers(wrong.span, line, column):
            parts.append(_story(wrong))
    if not parts:
        return None
    content = types.MarkupContent(types.MarkupKind.Markdown, "\n\n---\n\n".join(parts))
    return types.Hover(content, None if found is None else places.range(found.span))


def _covers(span: Span, line: int, column: int) -> bool:
    return (span.line, span.column) <= (line, column) <= (span.end_line, span.end_column)


def _story(wrong: Diagnostic) -> str:
    story = codes().get(wrong.code)
    if story is None:
        return f"**{wrong.code}** {wrong.message}"
    good = f"\n\n```koord\n{story.good.rstrip()}\n```" if story.good else ""
    return f"**{wrong.code}: {story.title}**\n\n{story.story.strip()}{good}"


def definition(
    document: Document, places: Places, position: types.Position
) -> types.Location | None:
    """Where the name at a place is declared."""
    target = document.definition(*places.line_and_column(position))
    if target is None:
        return None
    if not target.path:
        return places.location(target.span)
    path = Path(target.path)
    if not path.is_file():
        return None
    there = Places(Source(path.name, path.read_text(encoding="utf-8")), places.encoding)
    return types.Location(path.as_uri(), there.range(target.span))


def references(
    document: Document, places: Places, params: types.ReferenceParams
) -> list[types.Location]:
    """Where the symbol at a place is named."""
    spans = document.references(
        *places.line_and_column(params.position), declaration=params.context.include_declaration
    )
    return [found for span in spans if (found := places.location(span)) is not None]


def highlights(
    document: Document, places: Places, position: types.Position
) -> list[types.DocumentHighlight]:
    """The places of the symbol at a place."""
    spans = document.references(*places.line_and_column(position))
    own = places.source.name
    return [types.DocumentHighlight(places.range(span)) for span in spans if span.file == own]


def completions(
    document: Document, places: Places, position: types.Position, *, snippets: bool
) -> types.CompletionList:
    """What could stand at a place."""
    found = document.completions(*places.line_and_column(position))
    range_ = places.range(found.span)
    items = [_completion(item, range_, snippets=snippets) for item in found.items]
    return types.CompletionList(is_incomplete=False, items=items)


def _completion(item: Completion, range_: types.Range, *, snippets: bool) -> types.CompletionItem:
    is_snippet = item.is_snippet and snippets
    text = item.insert if is_snippet or not item.is_snippet else item.label
    return types.CompletionItem(
        label=item.label,
        kind=_COMPLETION_KINDS[item.kind],
        detail=item.detail or None,
        documentation=item.story or None,
        sort_text=f"{item.rank.value}{item.label.lower()}",
        insert_text_format=(
            types.InsertTextFormat.Snippet if is_snippet else types.InsertTextFormat.PlainText
        ),
        text_edit=types.TextEdit(range_, text),
    )


def signature_help(
    document: Document, places: Places, position: types.Position
) -> types.SignatureHelp | None:
    """The call around a place."""
    found = document.signature_help(*places.line_and_column(position))
    if found is None:
        return None
    signatures = [
        types.SignatureInformation(
            label=form.label,
            documentation=form.story or None,
            parameters=[types.ParameterInformation(one) for one in form.parameters],
        )
        for form in found.forms
    ]
    return types.SignatureHelp(
        signatures, active_signature=found.active, active_parameter=found.argument
    )


def formatting(document: Document, places: Places) -> list[types.TextEdit] | None:
    """The edit that puts the layout right; none of a text that cannot be read."""
    try:
        text = formatted(document.source)
    except KoordError:
        return None
    if text == document.source.text:
        return []
    return [types.TextEdit(places.everything, text)]


def prepare_rename(
    document: Document, places: Places, position: types.Position
) -> types.Range | str:
    """The range of the name that can be renamed; otherwise why it cannot."""
    found = document.renamable(*places.line_and_column(position))
    return found if isinstance(found, str) else places.range(found)


def rename(
    document: Document, places: Places, params: types.RenameParams
) -> types.WorkspaceEdit | str:
    """The edits of a renaming; otherwise why there are none."""
    line, column = places.line_and_column(params.position)
    found = document.rename(line, column, params.new_name)
    if found.refused:
        return found.refused
    changes: dict[str, list[types.TextEdit]] = {}
    for edit in found.edits:
        there = places.of(edit.span.file)
        if there is not None:
            changes.setdefault(there.uri, []).append(there.text_edit(edit))
    return types.WorkspaceEdit(changes=changes)


def symbols(document: Document, places: Places) -> list[types.DocumentSymbol]:
    """What the text declares."""
    return [made for symbol in document.symbols for made in _symbol(symbol, places)]


def _symbol(symbol: Symbol, places: Places) -> Iterable[types.DocumentSymbol]:
    if symbol.name_span is None or symbol.kind is SymbolKind.PARAMETER or not symbol.name:
        return
    name = places.range(symbol.name_span)
    whole = name if symbol.whole is None else places.range(symbol.whole)
    start = min(whole.start, name.start, key=lambda at: (at.line, at.character))
    end = max(whole.end, name.end, key=lambda at: (at.line, at.character))
    children = [made for child in symbol.children for made in _symbol(child, places)]
    yield types.DocumentSymbol(
        name=symbol.name,
        kind=_SYMBOL_KINDS.get(symbol.kind, types.SymbolKind.Variable),
        range=types.Range(start, end),
        selection_range=name,
        detail=symbol.kind.value,
        children=children or None,
    )


def semantic_tokens(document: Document, places: Places) -> types.SemanticTokens:
    """The names of the text by what they mean, each relative to the one before."""
    data: list[int] = []
    line = character = 0
    for token in document.semantic_tokens():
        at = places.range(token.span)
        if at.start.line != line:
            character = 0
        data += [
            at.start.line - line,
            at.start.character - character,
            at.end.character - at.start.character,
            TOKEN_KINDS.index(token.kind.value),
            _modifiers(token),
        ]
        line, character = at.start.line, at.start.character
    return types.SemanticTokens(data=data)


def _modifiers(token: SemanticToken) -> int:
    return sum(1 << TOKEN_MODIFIERS.index(modifier.value) for modifier in token.modifiers)


def folding(document: Document) -> list[types.FoldingRange]:
    """The lines that can be hidden."""
    return [
        types.FoldingRange(
            start_line=fold.first - 1,
            end_line=fold.last - 1,
            kind=types.FoldingRangeKind.Comment if fold.is_comment else None,
        )
        for fold in document.folds()
    ]


def inlays(document: Document, places: Places, range_: types.Range) -> list[types.InlayHint]:
    """Types and lock classes between the words of some lines."""
    return [
        types.InlayHint(
            position=places.position(hint.line, hint.column),
            label=hint.text,
            kind=types.InlayHintKind.Type,
        )
        for hint in document.inlays()
        if range_.start.line <= hint.line - 1 <= range_.end.line
    ]


def code_actions(
    document: Document, places: Places, uri: str, range_: types.Range
) -> list[types.CodeAction]:
    """The cures of what is wrong on some lines, and today's forms of all old ones."""
    actions: list[types.CodeAction] = []
    old: list[types.TextEdit] = []
    for found in document.diagnostics:
        if found.span.file != document.source.name:
            continue
        if found.code == "K407":
            old += [places.text_edit(edit) for edit in found.edits]
        if not found.span.line - 1 <= range_.end.line or not (
            range_.start.line <= found.span.end_line - 1
        ):
            continue
        for cure in document.cures(found):
            actions.append(
                types.CodeAction(
                    title=cure.title,
                    kind=types.CodeActionKind.QuickFix,
                    diagnostics=[_diagnostic(found, places, uri)],
                    edit=types.WorkspaceEdit(
                        changes={uri: [places.text_edit(edit) for edit in cure.edits]}
                    ),
                    is_preferred=True,
                )
            )
    if old:
        actions.append(
            types.CodeAction(
                title="Bring the program over to today's forms",
                kind=types.CodeActionKind.SourceFixAll,
                edit=types.WorkspaceEdit(changes={uri: old}),
            )
        )
    return actions


def file_name(uri: str) -> str:
    """The name of a document without a file, for messages and traces."""
    return uri.rpartition("/")[2] or "program.krd"
