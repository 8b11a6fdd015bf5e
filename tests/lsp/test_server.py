"""The server as an editor meets it: mistakes, names, edits; in one process, over streams."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types
from pygls.exceptions import JsonRpcException

import koord
from koord.api.editing import Edit, Source, Span
from koord.lsp.features import TOKEN_KINDS, file_name
from koord.lsp.settings import LspSettings
from koord.lsp.texts import changed
from tests.lsp.connected import URI, Editor, connected, run
from tests.sampling import first
from tests.syntax.test_editing import mutated

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"
TASK = (EXAMPLES / "task.krd").read_text("utf-8")
NEVER = {"verify": {"on": "never"}}


def place(text: str, of: str, more: int = 0) -> types.Position:
    line, column = Source("a.krd", text).place(text.index(of) + more)
    return types.Position(line - 1, column - 1)


def applied(text: str, edits: list[Any]) -> str:
    """A text after edits of the protocol, which do not overlap."""
    utf16 = types.PositionEncodingKind.Utf16
    for edit in sorted(edits, key=lambda e: (e.range.start.line, e.range.start.character))[::-1]:
        change = types.TextDocumentContentChangePartial(edit.range, edit.new_text)
        text = changed(text, change, utf16)
    return text


def test_mistakes_are_told_as_the_text_changes() -> None:
    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(TASK)
            assert await editor.checked() == []
            at = place(TASK, "mine = i")
            there = types.Range(at, types.Position(at.line, at.character + 4))
            editor.change(types.TextDocumentContentChangePartial(there, "mnie"))
            (found,) = await editor.checked()
            assert (found.code, found.range) == ("K201", there)
            assert "did you mean `mine`?" in found.message
            editor.replace(TASK)
            assert await editor.checked() == []

    run(work())


def test_names_are_found_hovered_and_renamed() -> None:
    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(TASK)
            client, here = editor.client, editor.document
            at = place(TASK, "mine@i", 1)
            hover = await client.text_document_hover_async(types.HoverParams(here, at))
            assert hover is not None
            assert isinstance(hover.contents, types.MarkupContent)
            assert "local int mine" in hover.contents.value
            target = await client.text_document_definition_async(types.DefinitionParams(here, at))
            assert isinstance(target, types.Location)
            assert target.range.start == place(TASK, "mine = -1")
            context = types.ReferenceContext(include_declaration=False)
            found = await client.text_document_references_async(
                types.ReferenceParams(context, here, at)
            )
            assert found is not None
            assert len(found) == 7
            edit = await client.text_document_rename_async(types.RenameParams(here, at, "own"))
            assert edit is not None
            assert edit.changes is not None
            assert applied(TASK, list(edit.changes[URI])) == TASK.replace("mine", "own")
            with pytest.raises(JsonRpcException, match="is taken"):
                await client.text_document_rename_async(types.RenameParams(here, at, "list"))
            library = await client.text_document_definition_async(
                types.DefinitionParams(here, place(TASK, "findPath("))
            )
            assert isinstance(library, types.Location)
            assert library.uri.endswith("prelude.krd")
            with pytest.raises(JsonRpcException, match="library"):
                await client.text_document_prepare_rename_async(
                    types.PrepareRenameParams(here, place(TASK, "findPath("))
                )

    run(work())


def test_completions_and_signatures_come_while_a_line_is_written() -> None:
    text = TASK.replace("mine = i\n", "mine = length(\n", 1)

    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(text)
            at = place(text, "length(\n", len("length("))
            found = await editor.client.text_document_completion_async(
                types.CompletionParams(editor.document, at)
            )
            assert isinstance(found, types.CompletionList)
            labels = {item.label: item for item in found.items}
            assert {"list", "route", "testRoute"} <= set(labels)
            edit = labels["route"].text_edit
            assert isinstance(edit, types.TextEdit)
            assert edit.range == types.Range(at, at)
            help_ = await editor.client.text_document_signature_help_async(
                types.SignatureHelpParams(editor.document, at)
            )
            assert help_ is not None
            assert help_.signatures[0].label == "length(list)"

    run(work())


def test_layout_tokens_folds_symbols_and_hints() -> None:
    text = TASK.replace("isOnTask = true", "isOnTask=true")

    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(text)
            client, here = editor.client, editor.document
            options = types.FormattingOptions(4, True)
            edits = await client.text_document_formatting_async(
                types.DocumentFormattingParams(here, options)
            )
            assert edits is not None
            assert applied(text, list(edits)) == koord.format(Source("a.krd", text))
            editor.replace(TASK)
            tokens = await client.text_document_semantic_tokens_full_async(
                types.SemanticTokensParams(here)
            )
            assert tokens is not None
            assert len(tokens.data) % 5 == 0
            assert list(tokens.data[:5]) == [9, 6, 6, TOKEN_KINDS.index("namespace"), 1]
            folds = await client.text_document_folding_range_async(types.FoldingRangeParams(here))
            assert folds is not None
            assert (9, 17) in {(fold.start_line, fold.end_line) for fold in folds}
            symbols = await client.text_document_document_symbol_async(
                types.DocumentSymbolParams(here)
            )
            assert symbols is not None
            names = [symbol.name for symbol in symbols]
            assert names[:2] == ["Motion", "tasks"]
            assert {"Assign", "Clearance", "Visited"} <= set(names)
            whole = types.Range(types.Position(0, 0), types.Position(999, 0))
            hints = await client.text_document_inlay_hint_async(types.InlayHintParams(here, whole))
            assert hints is not None
            assert [hint.label for hint in hints] == [" locks list"]

    run(work())


def test_a_mistake_is_cured_by_an_action() -> None:
    text = TASK.replace("pre: isOnTask and", "pre: isOnTsk and").replace(
        "using Motion", "# 🤖\nusing Motion"
    )

    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(text)
            (found,) = await editor.checked()
            actions = await editor.client.text_document_code_action_async(
                types.CodeActionParams(
                    editor.document, found.range, types.CodeActionContext([found])
                )
            )
            assert actions is not None
            (action,) = actions
            assert isinstance(action, types.CodeAction)
            assert action.edit is not None
            assert action.edit.changes is not None
            cured = applied(text, list(action.edit.changes[URI]))
            assert cured == text.replace("isOnTsk", "isOnTask")
            hover = await editor.client.text_document_hover_async(
                types.HoverParams(editor.document, found.range.start)
            )
            assert hover is not None
            assert isinstance(hover.contents, types.MarkupContent)
            assert "K201" in hover.contents.value

    run(work())


def test_old_forms_are_brought_over_by_one_action() -> None:
    text = "local:\n  int x = numBots\nGo:\n  pre (x > numBots);\n  eff: x = 1\n"

    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open(text)
            await editor.checked()
            nowhere = types.Range(types.Position(4, 0), types.Position(4, 0))
            actions = await editor.client.text_document_code_action_async(
                types.CodeActionParams(editor.document, nowhere, types.CodeActionContext([]))
            )
            assert actions is not None
            (action,) = actions
            assert isinstance(action, types.CodeAction)
            assert action.kind == types.CodeActionKind.SourceFixAll
            assert action.edit is not None
            assert action.edit.changes is not None
            editor.replace(applied(text, list(action.edit.changes[URI])))
            assert [d for d in await editor.checked() if d.code == "K407"] == []

    run(work())


def test_what_is_wrong_with_a_request_is_an_answer() -> None:
    async def work() -> None:
        async with connected(NEVER) as editor:
            with pytest.raises(JsonRpcException, match="is not open"):
                await editor.client.text_document_hover_async(
                    types.HoverParams(editor.document, types.Position(0, 0))
                )
            with pytest.raises(JsonRpcException):
                await editor.client.workspace_execute_command_async(
                    types.ExecuteCommandParams("koord.counterexample", [URI])
                )
            editor.open("local:\n  int x = 0\n")
            far = types.Position(10_000, 10_000)
            assert (
                await editor.client.text_document_hover_async(
                    types.HoverParams(editor.document, far)
                )
                is None
            )

    run(work())


def test_a_request_that_cannot_be_read_is_answered_by_why() -> None:
    """A client that hears nothing would wait for ever."""

    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open("local:\n  int x = 0\n")
            for method, given, reason in (
                ("formatting", {"textDocument": {"uri": URI}, "options": {}}, "tabSize"),
                ("hover", {"textDocument": {"uri": URI}}, "position"),
                ("hover", {"textDocument": 5, "position": None}, "textDocument"),
            ):
                with pytest.raises(JsonRpcException, match=reason):
                    await editor.raw(f"textDocument/{method}", given)
            assert [found.code for found in await editor.checked()] == ["K403"]

    run(work())


def test_wrong_settings_are_told_and_the_others_stay() -> None:
    async def work() -> None:
        async with connected({"verify": {"on": "sometimes"}}) as editor:
            await editor.until(lambda: editor.messages)
            assert "settings of koord" in editor.messages[0]
            assert editor.server.settings == LspSettings()
            editor.client.workspace_did_change_configuration(
                types.DidChangeConfigurationParams({"koord": {"verify": {"on": "save"}}})
            )
            editor.open("local:\n  int x = 0\n")
            await editor.checked()
            assert editor.server.settings.verify.on == "save"

    run(work())


def test_names_of_files_come_from_their_addresses() -> None:
    assert file_name("file:///a/b%20c.krd") == "b%20c.krd"
    assert file_name("untitled:1") == "untitled:1"
    assert file_name("") == "program.krd"
    assert Edit(Span("a", 1, 1, 1, 1), "x").text == "x"


# --- whatever is typed ----------------------------------------------------------------------------


async def typed(editor: Editor, rng: random.Random, edits: int) -> None:
    """Type at random into an example, and ask something after each change."""
    paths = sorted(EXAMPLES.glob("*.krd"))
    text = ""
    client, here = editor.client, editor.document
    for number in range(edits):
        if number % 50 == 0:
            text = rng.choice(paths).read_text("utf-8")
            editor.replace(text)
        after = mutated(text, rng).replace("\r", "")  # of which see test_texts.py
        start = _common(text, after)
        end = _common(text[start:][::-1], after[start:][::-1])
        # at the ends of what both have: the smallest change, as editors send it
        change = types.TextDocumentContentChangePartial(
            types.Range(_position(text, start), _position(text, len(text) - end)),
            after[start : len(after) - end],
        )
        editor.change(change)
        text = after
        at = types.Position(rng.randrange(text.count("\n") + 2), rng.randrange(60))
        match rng.randrange(8):
            case 0:
                await client.text_document_hover_async(types.HoverParams(here, at))
            case 1:
                await client.text_document_completion_async(types.CompletionParams(here, at))
            case 2:
                await client.text_document_semantic_tokens_full_async(
                    types.SemanticTokensParams(here)
                )
            case 3:
                await client.text_document_signature_help_async(types.SignatureHelpParams(here, at))
            case 4:
                there = types.CodeActionParams(
                    here, types.Range(at, at), types.CodeActionContext([])
                )
                await client.text_document_code_action_async(there)
            case 5:
                await client.text_document_document_symbol_async(types.DocumentSymbolParams(here))
            case 6:
                await client.text_document_definition_async(types.DefinitionParams(here, at))
            case _:
                await client.text_document_code_lens_async(types.CodeLensParams(here))
    assert editor.server.texts[URI].text == text
    assert editor.messages == []


def _common(one: str, other: str) -> int:
    """How many characters two texts begin with alike."""
    for at, (a, b) in enumerate(zip(one, other, strict=False)):
        if a != b:
            return at
    return min(len(one), len(other))


def _position(text: str, at: int) -> types.Position:
    before = text[:at].replace("\r\n", "\n").replace("\r", "\n")
    line = before.count("\n")
    tail = before.rpartition("\n")[2]
    return types.Position(line, len(tail.encode("utf-16-le")) // 2)


@pytest.mark.parametrize("seed", first(1, range(3)))
def test_no_edit_is_too_much_for_the_server(seed: int) -> None:
    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open("")
            await typed(editor, random.Random(seed), 40)

    run(work())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
def test_nor_are_ten_thousand(seed: int) -> None:
    async def work() -> None:
        async with connected(NEVER) as editor:
            editor.open("")
            await typed(editor, random.Random(seed), 500)

    asyncio.run(work())
