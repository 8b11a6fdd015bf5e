"""A program of several files in an editor: names and verdicts go through all of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lsprotocol import types

from tests.lsp.connected import Editor, connected, run
from tests.lsp.test_server import NEVER, applied, place

PROGRAM = """\
param int most = 3
local:
  int x = 0
Step:
  pre: x < most
  eff: x = x + 1
invariant Low: forall i: x@i >= 0
"""
PROPERTIES = """\
# of the counter
invariant Few: forall i: x@i <= most
invariant Odd: forall i: x@i != most
"""
CONFIGURATION = "agents: [a, b]\nparams: {most: 2}\n"


def folder(path: Path, said: str = "") -> dict[str, str]:
    """Write the files of a program; their addresses by name."""
    texts = {
        "app.krd": said + PROGRAM,
        "more.krd": PROPERTIES,
        "app.yaml": CONFIGURATION,
    }
    for name, text in texts.items():
        (path / name).write_text(text, "utf-8")
    return {name: (path / name).as_uri() for name in texts}


def identifier(uri: str) -> types.TextDocumentIdentifier:
    return types.TextDocumentIdentifier(uri)


async def references(editor: Editor, uri: str, at: types.Position) -> list[str]:
    found = await editor.client.text_document_references_async(
        types.ReferenceParams(types.ReferenceContext(True), identifier(uri), at)
    )
    assert found is not None
    return [f"{Path(one.uri).name}:{one.range.start.line + 1}" for one in found]


def open_(editor: Editor, uri: str, text: str) -> None:
    item = types.TextDocumentItem(uri, "koord", 1, text)
    editor.client.text_document_did_open(types.DidOpenTextDocumentParams(item))


def test_names_lead_through_all_files(tmp_path: Path) -> None:
    uri = folder(tmp_path)

    async def work() -> None:
        async with connected(NEVER) as editor:
            open_(editor, uri["more.krd"], PROPERTIES)
            inside = place(PROPERTIES, "most")
            target = await editor.client.text_document_definition_async(
                types.DefinitionParams(identifier(uri["more.krd"]), inside)
            )
            assert isinstance(target, types.Location)
            assert (target.uri, target.range.start.line) == (uri["app.krd"], 0)
            every = ["app.krd:1", "app.krd:5", "more.krd:2", "more.krd:3", "app.yaml:2"]
            assert await references(editor, uri["more.krd"], inside) == every
            open_(editor, uri["app.krd"], PROGRAM)
            assert await references(editor, uri["app.krd"], place(PROGRAM, "most")) == every
            marked = await editor.client.text_document_document_highlight_async(
                types.DocumentHighlightParams(identifier(uri["app.krd"]), place(PROGRAM, "most"))
            )
            assert marked is not None
            assert len(marked) == 2

    run(work())


def test_a_renaming_goes_through_all_files(tmp_path: Path) -> None:
    uri = folder(tmp_path, "# koord verify: --with more.krd\n")
    program = (tmp_path / "app.krd").read_text("utf-8")
    (tmp_path / "other.krd").write_text(PROGRAM, "utf-8")  # the comment tells them apart

    async def work() -> Any:
        async with connected(NEVER) as editor:
            open_(editor, uri["more.krd"], PROPERTIES)
            params = types.RenameParams(
                identifier(uri["more.krd"]), place(PROPERTIES, "most"), "limit"
            )
            edit = await editor.client.text_document_rename_async(params)
            assert edit is not None
            assert edit.changes is not None
            return edit.changes

    changes = run(work())
    texts = {"app.krd": program, "more.krd": PROPERTIES, "app.yaml": CONFIGURATION}
    assert set(changes) == {uri[name] for name in texts}
    for name, text in texts.items():
        assert applied(text, list(changes[uri[name]])) == text.replace("most", "limit")


def test_a_change_of_one_file_is_told_in_the_others(tmp_path: Path) -> None:
    uri = folder(tmp_path)

    async def work() -> None:
        async with connected(NEVER) as editor:

            def codes(name: str) -> list[str | int | None]:
                newest = [d for d in editor.diagnostics if d.uri == uri[name]]
                return [d.code for d in newest[-1].diagnostics] if newest else ["none yet"]

            open_(editor, uri["app.krd"], PROGRAM)
            open_(editor, uri["more.krd"], PROPERTIES)
            await editor.until(lambda: codes("app.krd") == codes("more.krd") == [])
            here = types.VersionedTextDocumentIdentifier(2, uri["app.krd"])
            at = place(PROGRAM, "int x")
            change = types.TextDocumentContentChangePartial(
                types.Range(at, types.Position(at.line, at.character + 5)), "int y"
            )
            editor.client.text_document_did_change(
                types.DidChangeTextDocumentParams(here, [change])
            )
            await editor.until(lambda: codes("app.krd") == ["K403", "K201"])
            await editor.until(lambda: codes("more.krd") == ["K201"])
            (told,) = [d for d in editor.diagnostics if d.uri == uri["more.krd"]][-1].diagnostics
            assert told.message.startswith("app.krd:5:8: `x` is not declared")
            assert told.range.start == types.Position(0, 0)

    run(work())


def test_verdicts_stand_in_the_file_of_their_claims(tmp_path: Path) -> None:
    uri = folder(tmp_path)
    settings = {"verify": {"robots": 2, "delayS": 0.0, "jobs": 1}}

    async def work() -> None:
        async with connected(settings) as editor:

            def marks(name: str) -> dict[str, tuple[str, int]] | None:
                done = [v for v in editor.verdicts if v.uri == uri[name] and v.state == "done"]
                return {m.name: (m.kind, m.line) for m in done[-1].marks} if done else None

            open_(editor, uri["app.krd"], PROGRAM)
            await editor.until(lambda: marks("app.krd") is not None)
            found = marks("app.krd")
            assert found is not None
            assert found["Low"] == ("holds", 6)
            assert found["Odd"] == ("violated", 0)  # its own file is not open
            assert "Few" not in found
            open_(editor, uri["more.krd"], PROPERTIES)
            await editor.until(lambda: marks("more.krd") is not None)
            assert marks("more.krd") == {"Few": ("holds", 1), "Odd": ("violated", 2)}

    run(work())


def test_completions_and_cures_in_a_file_of_properties(tmp_path: Path) -> None:
    uri = folder(tmp_path)
    text = PROPERTIES.replace("x@i != most", "x@i != mots")

    async def work() -> None:
        async with connected(NEVER) as editor:
            open_(editor, uri["more.krd"], text)
            at = place(text, "mots", 1)
            found = await editor.client.text_document_completion_async(
                types.CompletionParams(identifier(uri["more.krd"]), at)
            )
            assert isinstance(found, types.CompletionList)
            assert {"x", "most"} <= {item.label for item in found.items}
            actions = await editor.client.text_document_code_action_async(
                types.CodeActionParams(
                    identifier(uri["more.krd"]),
                    types.Range(at, at),
                    types.CodeActionContext([]),
                )
            )
            assert actions
            (action,) = (one for one in actions if isinstance(one, types.CodeAction))
            assert action.edit is not None
            assert action.edit.changes is not None
            assert applied(text, list(action.edit.changes[uri["more.krd"]])) == PROPERTIES
            outline = await editor.client.text_document_document_symbol_async(
                types.DocumentSymbolParams(identifier(uri["more.krd"]))
            )
            assert outline is not None
            assert [one.name for one in outline] == ["Few", "Odd"]

    run(work())
