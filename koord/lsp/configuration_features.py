"""What the protocol asks about the fields of a configuration, answered in its types."""

from __future__ import annotations

from lsprotocol import types

from koord.api.configuration_fields import completions_at, field_at
from koord.api.editing import Source
from koord.lsp.places import Places


def field_hover(places: Places, position: types.Position) -> types.Hover | None:
    """What the field means whose name is there."""
    found = field_at(places.source, *places.line_and_column(position))
    if found is None:
        return None
    span, field = found
    content = types.MarkupContent(types.MarkupKind.Markdown, field.markdown)
    return types.Hover(content, places.range(span))


def field_completions(
    places: Places, program: Source | None, position: types.Position
) -> types.CompletionList | None:
    """The fields, or the values, that could be written there."""
    found = completions_at(places.source, *places.line_and_column(position), program)
    if found is None:
        return None
    range_ = places.range(found.span)
    items = [
        types.CompletionItem(
            label=value.text,
            kind=types.CompletionItemKind.Value,
            detail=value.detail or None,
            text_edit=types.TextEdit(range_, value.text),
        )
        for value in found.values
    ]
    for field in found.fields:
        behind = "" if found.is_named else ":" if field.has_fields else ": "
        items.append(
            types.CompletionItem(
                label=field.name,
                kind=types.CompletionItemKind.Property,
                detail=field.type.replace("`", ""),
                documentation=field.story or None,
                text_edit=types.TextEdit(range_, field.name + behind),
            )
        )
    return types.CompletionList(is_incomplete=False, items=items)
