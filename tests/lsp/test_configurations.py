"""Configurations in an editor: their mistakes as they are typed, alone and with their program."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types

from koord.api.configuration_fields import field_at, fields_for
from koord.api.configuration_texts import checked_text, is_configuration
from koord.api.configurations import check_configuration
from koord.api.editing import Source
from koord.runtime.configuration.forms import Agent, Device, WorldForm
from tests.lsp.connected import CAPABILITIES, Editor, connected, run
from tests.lsp.test_program_files import PROGRAM, identifier
from tests.lsp.test_server import EXAMPLES, NEVER, applied, place
from tests.sampling import first
from tests.syntax.test_editing import mutated

#: Nothing waits for a pause in typing.
AT_ONCE = {"verify": {"on": "never", "delayS": 0.0}}
TEXT = """\
agents:
    - {pid: 0, on_device: car}
    - {pid: 1, on_device: car}
devices:
    car: {bot_type: CAR, planner: RRT_CAR}
params: {most: 2}
"""
WARNING = types.DiagnosticSeverity.Warning


class Pair:
    """A program and its configuration, side by side in an editor."""

    def __init__(self, editor: Editor, folder: Path) -> None:
        self.editor = editor
        self.program, self.configuration = folder / "app.krd", folder / "app_two.yaml"
        self.version = 1

    def open(self, path: Path, text: str, language: str) -> None:
        item = types.TextDocumentItem(path.as_uri(), language, self.version, text)
        self.editor.client.text_document_did_open(types.DidOpenTextDocumentParams(item))

    def replace(self, path: Path, text: str) -> None:
        self.version += 1
        here = types.VersionedTextDocumentIdentifier(self.version, path.as_uri())
        change = types.TextDocumentContentChangeWholeDocument(text)
        self.editor.client.text_document_did_change(
            types.DidChangeTextDocumentParams(here, [change])
        )

    def told(self, path: Path) -> list[types.Diagnostic]:
        found = [d for d in self.editor.diagnostics if d.uri == path.as_uri()]
        return list(found[-1].diagnostics) if found else []

    async def newest(self, path: Path) -> list[types.Diagnostic]:
        """What is wrong with the newest text of a file that was changed last."""
        await self.editor.until(
            lambda: any(
                d.uri == path.as_uri() and d.version == self.version
                for d in self.editor.diagnostics
            )
        )
        return self.told(path)


def test_mistakes_of_a_configuration_are_told_as_it_is_typed(tmp_path: Path) -> None:
    """The text in the editor counts, not the file, of which there need be none."""

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            yaml = pair.configuration
            pair.open(yaml, TEXT, "yaml")
            assert await pair.newest(yaml) == []
            text = TEXT.replace("planner", "# 🤖\n         plannner")
            pair.replace(yaml, text)
            (found,) = await pair.newest(yaml)
            at = place(text, "plannner")
            assert found.range == types.Range(at, types.Position(at.line, at.character + 8))
            assert (found.code, found.severity) == ("K931", types.DiagnosticSeverity.Error)
            assert "help: did you mean `planner`?" in found.message
            pair.replace(yaml, TEXT + "world: {")
            (found,) = await pair.newest(yaml)
            assert found.code == "K930"
            automaton = TEXT.replace("on_device", "motion_automaton: Nobody, on_device", 1)
            pair.replace(yaml, automaton)
            (found,) = await pair.newest(yaml)
            assert (found.code, found.severity) == ("K949", WARNING)
            assert found.range.start.line == 1
            pair.replace(yaml, TEXT)
            assert await pair.newest(yaml) == []

    run(work())


def test_a_configuration_is_checked_with_its_program_as_both_are_in_the_editor(
    tmp_path: Path,
) -> None:
    (tmp_path / "app.krd").write_text(PROGRAM.replace("most", "saved"), "utf-8")
    (tmp_path / "app_two.yaml").write_text("", "utf-8")

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            program, yaml = pair.program, pair.configuration
            pair.open(program, PROGRAM, "koord")
            pair.open(yaml, TEXT, "yaml")
            assert await pair.newest(yaml) == []
            pair.replace(yaml, TEXT.replace("most", "msot"))
            (found,) = await pair.newest(yaml)
            assert found.range.start == place(TEXT, "most")
            assert "msot" in found.message
            # the program takes the name: its configuration is told, though it has not changed
            pair.replace(program, PROGRAM.replace("most", "msot"))
            await editor.until(lambda: pair.told(yaml) == [])
            pair.replace(program, PROGRAM)
            await editor.until(lambda: len(pair.told(yaml)) == 1)
            # its mistakes are told in its configuration, too, which cannot be run
            pair.replace(program, PROGRAM.replace("int x", "int y"))
            await editor.until(lambda: any(d.code == "K201" for d in pair.told(yaml)))
            (found,) = [d for d in pair.told(yaml) if d.code == "K201"]
            assert found.message.startswith("app.krd:5:8: ")
            assert found.range.start == types.Position(0, 0)

    run(work())


def test_a_renaming_counts_on_the_configuration_in_the_editor(tmp_path: Path) -> None:
    (tmp_path / "app.krd").write_text(PROGRAM, "utf-8")
    (tmp_path / "app_two.yaml").write_text(TEXT, "utf-8")
    typed = "# two\n" + TEXT

    async def work() -> Any:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            pair.open(pair.program, PROGRAM, "koord")
            await pair.newest(pair.program)
            pair.open(pair.configuration, TEXT, "yaml")
            pair.replace(pair.configuration, typed)
            await pair.newest(pair.configuration)
            params = types.RenameParams(
                identifier(pair.program.as_uri()), place(PROGRAM, "most"), "limit"
            )
            edit = await editor.client.text_document_rename_async(params)
            assert edit is not None
            assert edit.changes is not None
            return edit.changes[pair.configuration.as_uri()]

    assert applied(typed, list(run(work()))) == typed.replace("most", "limit")


def test_what_else_is_asked_about_a_configuration_has_no_answer(tmp_path: Path) -> None:
    async def work() -> None:
        async with connected({"verify": {"delayS": 0.0}}) as editor:
            pair = Pair(editor, tmp_path)
            pair.open(pair.configuration, TEXT, "yaml")
            here, at = identifier(pair.configuration.as_uri()), types.Position(0, 2)
            client = editor.client
            found = await client.text_document_definition_async(types.DefinitionParams(here, at))
            assert found is None
            options = types.FormattingOptions(4, True)
            assert not await client.text_document_formatting_async(
                types.DocumentFormattingParams(here, options)
            )
            assert not await client.text_document_code_lens_async(types.CodeLensParams(here))
            for command in ("koord.verify", "koord.cancelVerification"):
                await client.workspace_execute_command_async(
                    types.ExecuteCommandParams(command, [here.uri])
                )
            client.text_document_did_save(types.DidSaveTextDocumentParams(here))
            client.text_document_did_close(types.DidCloseTextDocumentParams(here))
            await editor.until(lambda: len(editor.diagnostics) == 2)
            assert (editor.verdicts, editor.messages) == ([], [])

    run(work())


def test_files_of_other_tools_are_left_alone(tmp_path: Path) -> None:
    scene = "world_name: arena\nagents: {}\n"
    others = [
        "",
        "name: ci\non: push\n",
        "agents: {queue: a}\nsteps: []\nenv: {}\n",
        "- a\n",
        scene,
    ]
    for text in others:
        assert checked_text("a.yaml", tmp_path / "a.yaml", text, lambda _: None).diagnostics == ()
    for text in ("agents: [", "num_robots: 3\ndetla: 1\n", "'bots': {}\nrobot:\n", "  \ndevice:\n"):
        assert is_configuration(text)
    for text in ("  agents: []\n", "agents\n", "agents:x\n", "# devices: {}\n", others[2]):
        assert not is_configuration(text)


@pytest.mark.parametrize("path", first(4, sorted(EXAMPLES.glob("*.yaml"))), ids=lambda p: p.name)
def test_an_editor_says_of_an_example_what_the_command_says(path: Path) -> None:
    text = path.read_text("utf-8")
    told = checked_text(path.name, path, text, lambda _: None)
    assert is_configuration(text) == (path.name != "expected.yaml")
    if is_configuration(text):
        program = told.program
        assert program is not None or path.with_suffix(".krd").exists() is False
        assert told.diagnostics == check_configuration(Source(path.name, text), program).diagnostics


def test_a_client_that_can_is_asked_for_the_texts_of_configurations() -> None:
    """Not for more, lest it takes the server for a formatter of YAML."""
    asked: list[types.Registration] = []
    capabilities = types.ClientCapabilities(
        text_document=types.TextDocumentClientCapabilities(
            synchronization=types.TextDocumentSyncClientCapabilities(dynamic_registration=True)
        )
    )

    async def work(capabilities: types.ClientCapabilities) -> None:
        async with connected(NEVER, capabilities) as editor:

            @editor.client.feature(types.CLIENT_REGISTER_CAPABILITY)
            def registered(params: types.RegistrationParams) -> None:
                asked.extend(params.registrations)

            editor.open("local:\n  int x = 0\n")
            await editor.checked()

    run(work(CAPABILITIES))
    assert asked == []
    run(work(capabilities))
    methods = {f"textDocument/{what}" for what in ("didOpen", "didChange", "didClose")}
    methods |= {"textDocument/hover", "textDocument/completion"}
    assert {one.method for one in asked} == methods


def test_a_hover_says_what_a_field_means(tmp_path: Path) -> None:
    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            pair.open(pair.configuration, "# 🤖\n" + TEXT, "yaml")

            async def told(of: str, more: int = 1) -> str | None:
                at = place("# 🤖\n" + TEXT, of, more)
                found = await editor.client.text_document_hover_async(
                    types.HoverParams(identifier(pair.configuration.as_uri()), at)
                )
                if found is None:
                    return None
                assert found.range is not None
                assert found.range.start == place("# 🤖\n" + TEXT, of)
                assert isinstance(found.contents, types.MarkupContent)
                return found.contents.value

            device = await told("devices")
            assert device is not None
            assert device.startswith("`devices`: fields or list\n\n")
            assert device.endswith("A vehicle.")
            kind = await told("bot_type")
            assert kind is not None
            assert "`CAR`" in kind
            assert kind.endswith('by default `"CAR"`')
            assert await told("pid") == "`pid`: integer ≥ 0"
            assert await told("car: {") is None  # a name that its author chose
            assert await told("RRT_CAR") is None
            pair.replace(pair.configuration, "{")
            assert await told("devices") is None

    run(work())


def test_what_is_said_of_fields_is_text() -> None:
    """Lines with an indent would be code."""
    source = Source("a.yaml", "agents: []\nnetwork: {}\n")
    found = field_at(source, 2, 1)
    assert found is not None
    lines = found[1].markdown.splitlines()
    assert lines[0] == "`network`: fields"
    assert len(lines) > 3
    assert not any(line.startswith(" ") for line in lines)


def fields(text: str) -> set[str] | None:
    """What is offered at the ‸ of a text."""
    at = text.index("‸")
    source = Source("a.yaml", text.replace("‸", ""))
    found = fields_for(source, *source.place(at))
    if found is None:
        return None
    return {one.name for one in found.fields}


def test_fields_are_completed_by_the_lines_around_them() -> None:
    top = fields(TEXT + "wo‸")
    assert top is not None
    assert {"world", "delta", "network"} <= top
    assert not top & {"agents", "devices", "params", "pid"}
    assert fields("agents:\n  - pid: 0\n    ‸\n") == set(Agent.__struct_fields__)
    assert fields("agents:\n- ‸\n") == set(Agent.__struct_fields__)
    assert fields("devices:\n  car:\n    speed: 1\n    ‸") == set(Device.__struct_fields__)
    assert fields("agents: []\nworld:\n  bounds:\n    low: [0, 0]\n  ‸") == set(
        WorldForm.__struct_fields__
    )
    assert fields("agents: []\nparams:\n  ‸") == set()
    assert fields("agents: [‸") is None
    assert fields("delta: 0.‸1\nagents: []") is None
    assert fields("name: ci\n‸") is None


def test_a_completion_replaces_the_word_at_the_cursor(tmp_path: Path) -> None:
    text = TEXT + "wor"

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            pair.open(pair.configuration, text, "yaml")
            at = types.Position(text.count("\n"), 3)
            found = await editor.client.text_document_completion_async(
                types.CompletionParams(identifier(pair.configuration.as_uri()), at)
            )
            assert isinstance(found, types.CompletionList)
            (world,) = [one for one in found.items if one.label == "world"]
            assert isinstance(world.text_edit, types.TextEdit)
            assert applied(text, [world.text_edit]) == TEXT + "world:"
            (delta,) = [one for one in found.items if one.label == "delta"]
            assert isinstance(delta.text_edit, types.TextEdit)
            assert applied(text, [delta.text_edit]) == TEXT + "delta: "

    run(work())


async def typed(pair: Pair, rng: random.Random, edits: int) -> None:
    """Type at random into configurations beside their programs."""
    texts = [path.read_text("utf-8") for path in sorted(EXAMPLES.glob("*.yaml"))]
    texts = [text for text in texts if is_configuration(text)]
    program = (EXAMPLES / "task.krd").read_text("utf-8")
    pair.open(pair.program, program, "koord")
    text = ""
    pair.open(pair.configuration, text, "yaml")
    for number in range(edits):
        text = rng.choice(texts) if number % 20 == 0 else mutated(text, rng)
        pair.replace(pair.configuration, text)
        if number % 4 == 0:
            await pair.newest(pair.configuration)
        here = identifier(pair.configuration.as_uri())
        at = types.Position(rng.randrange(text.count("\n") + 2), rng.randrange(30))
        client = pair.editor.client
        await client.text_document_hover_async(types.HoverParams(here, at))
        await client.text_document_completion_async(types.CompletionParams(here, at))
    await pair.newest(pair.configuration)
    assert pair.editor.server.texts[pair.configuration.as_uri()].text == text
    assert pair.editor.messages == []


@pytest.mark.parametrize("seed", first(1, range(3)))
def test_no_edit_of_a_configuration_is_too_much(seed: int, tmp_path: Path) -> None:
    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            await typed(Pair(editor, tmp_path), random.Random(seed), 40)

    run(work())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 110))
def test_nor_are_thousands(seed: int, tmp_path: Path) -> None:
    (tmp_path / "app.krd").write_text((EXAMPLES / "task.krd").read_text("utf-8"), "utf-8")

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            await typed(Pair(editor, tmp_path), random.Random(seed), 300)

    run(work())
