"""Configurations in an editor: their mistakes as they are typed, alone and with their program."""

from __future__ import annotations

import random
import threading
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types
from msgspec import Struct

from koord.api.configuration_fields import completions_at, field_at
from koord.api.configuration_texts import checked_text, configuration_text, is_configuration
from koord.api.configurations import check_configuration
from koord.api.editing import Severity, Source
from koord.api.field_comments import field_comments
from koord.runtime.configuration import forms
from koord.runtime.configuration.forms import Agent, Device, WorldForm
from koord.runtime.motion.bodies import VEHICLES, PlannerName
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
        program = next(iter(told.others), None)
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
            assert device.startswith("`devices`: object of Device or list of Device\n\n")
            assert device.endswith("the vehicles by their names\n\nA vehicle.")
            kind = await told("bot_type")
            assert kind is not None
            assert '`"CAR"`, `"QUAD"`' in kind
            assert 'by default `"CAR"`\n\n' in kind
            pid = await told("pid")
            assert pid is not None
            assert pid.startswith("`pid`: integer ≥ 0\n\nits number")
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
    assert lines[0] == "`network`: NetworkForm or null"
    assert len(lines) > 3
    assert not any(line.startswith(" ") for line in lines)


def test_every_field_says_what_it_means() -> None:
    found = [one for one in vars(forms).values() if isinstance(one, type)]
    structs = [one for one in found if issubclass(one, Struct) and one is not Struct]
    assert len(structs) > 20
    for one in structs:
        assert set(field_comments(one)) == set(one.__struct_fields__), one


#: A program with params, modules and kinds of robot, in the order of an unfinished text.
DECLARES = """\
param int most = 3  # of tasks
using Motion:
    sensors:
        pos psn
agent Scout:
    local:
        int x = treu
"""


def offered(text: str) -> set[str] | None:
    """What is offered at the ‸ of a text, beside the program above."""
    at = text.index("‸")
    source = Source("a.yaml", text.replace("‸", ""))
    found = completions_at(source, *source.place(at), Source("a.krd", DECLARES))
    if found is None:
        return None
    return {one.name for one in found.fields} | {one.text for one in found.values}


def test_fields_are_completed_by_the_lines_around_them() -> None:
    top = offered(TEXT + "wo‸")
    assert top is not None
    assert {"world", "delta", "network"} <= top
    assert not top & {"agents", "devices", "params", "pid"}
    assert offered("agents:\n  - pid: 0\n    ‸\n") == set(Agent.__struct_fields__) - {"pid"}
    assert offered("agents:\n- ‸\n") == set(Agent.__struct_fields__)
    assert offered("devices:\n  car:\n    speed: 1\n    ‸\n    port: 1\n") == set(
        Device.__struct_fields__
    ) - {"speed", "port"}
    assert offered("agents: []\nworld:\n  bounds:\n    low: [0, 0]\n  ‸") == set(
        WorldForm.__struct_fields__
    ) - {"bounds"}
    assert offered("agents: []\nparams:\n  ‸") == {"most"}
    assert offered("devices: {car: {modules: {‸") == {"Motion"}
    assert offered("agents: [‸") is None
    assert offered("delta: 0.‸1\nagents: []") is None


def test_fields_are_completed_between_braces() -> None:
    agent = set(Agent.__struct_fields__)
    assert offered("agents: [{‸") == agent
    assert offered("agents: [{pid: 0, ‸") == agent - {"pid"}
    assert offered("agents:\n  - {‸, heading: 1}\n") == agent - {"heading"}
    assert offered("agents:\n  - {\n    pid: 0,\n    ‸\n  }\nseed: 1\n") == agent - {"pid"}
    assert offered("agents: [{pid: 0}, {‸}]\n") == agent
    assert offered(
        "agents:\n  - {pid: 0}\n  - {pid: 1, ‸\ndevices: {car: {speed: 1}}\n"
    ) == agent - {"pid"}
    low = {"low", "high"}
    assert offered("world: {bounds: {low: [0, 0], ‸}}") == low - {"low"}
    assert offered("world: {obstacles: [{box: {‸}}]}") == low
    assert offered("agents: [{pid: 0}] # {‸") is None
    assert offered("seed: '{‸'") is None


def test_values_are_completed() -> None:
    assert offered("network: {encrypt: ‸}") == {"true", "false"}
    assert offered("network:\n  encrypt: t‸\n  port: 1\n") == {"true", "false"}
    assert offered("network:\n  transport: ‸") == {one.value for one in forms.Carrier}
    assert offered("devices: {d: {bot_type: C‸AR}}") == set(VEHICLES)
    assert offered("devices: {d: {simulation: {level: ‸") == {"simple", "full", "fast", "mujoco"}
    assert offered("delta: ‸") is None
    automata = {"MoatTestCar", "MoatTestDrone", "MoatHectorQuadrotor"}
    assert offered("devices: {d: {motion_automata: [Mo‸]}}") == automata
    assert offered("device:\n  motion_automata:\n    - Mo‸\n") == automata
    assert offered("agents: [{motion_automaton: ‸}]") == automata
    assert offered("agents: [{kind: ‸}]") == {"Scout"}


def test_planners_are_those_of_the_vehicle() -> None:
    def own(name: str) -> set[str]:
        return {one.value for one in VEHICLES[name].planners}

    def planners(text: str) -> set[str]:
        found = offered(text)
        assert found is not None
        return found & {one.value for one in PlannerName}

    assert planners("devices:\n  d:\n    planner: ‸\n    bot_type: DIFF\n") == own("DIFF")
    assert planners("devices: {d: {bot_type: QUAD, planner: ‸}}") == own("QUAD")
    assert planners("devices: {d: {planner: R‸}}") == own("CAR")
    assert planners("device: {motion: {planner: ‸}}") == {one.value for one in PlannerName}


def test_devices_and_drivers_are_completed_by_their_names() -> None:
    text = "agents:\n  - {pid: 0, on_device: ‸\n"
    assert offered(text + "devices:\n  car: {speed: 1}\n  fan:\n    port: 1\n") == {"car", "fan"}
    assert offered(text + "devices:\n  - bot_name: car\n    port: 1\n  - {bot_name: fan}\n") == {
        "car",
        "fan",
    }
    drivers = offered("device: {driver: ‸}")
    assert drivers is not None
    assert {"mavlink", "sim"} <= drivers
    localisers = offered("localiser: ‸")
    assert localisers is not None
    assert offered("device: {localiser: ‸}") == localisers | {"own"}


def test_a_site_and_a_scene_are_said_in_a_comment(tmp_path: Path) -> None:
    """They are checked with the configuration, and mistakes stand in the file that has them."""
    main = tmp_path / "app.yaml"
    said = "# koord config check: --site lab.yaml --scene start.yml\n" + TEXT
    (tmp_path / "app.krd").write_text(PROGRAM, "utf-8")
    (tmp_path / "other.yaml").write_text("num_robots: 2\n", "utf-8")
    site = "world:\n    tasks: [[1, 2]]\n"
    (tmp_path / "lab.yaml").write_text(site, "utf-8")
    main.write_text(TEXT, "utf-8")
    scene = "".join(
        f"- {{bot_name: {name}, bot_type: CAR, init_pos: [1, {y}, 0]}}\n"
        for y, name in enumerate(("car", "other"))
    )
    (tmp_path / "start.yml").write_text(scene, "utf-8")

    def told(text: str, name: str = "app.yaml") -> list[str]:
        opened = {main: said}.get
        found = checked_text(name, tmp_path / name, text, opened).diagnostics
        wrong = [one for one in found if one.severity is Severity.ERROR]
        return [f"{one.span.file}:{one.span.line}: {one.code}" for one in wrong]

    assert told(said) == []
    assert told(site, "lab.yaml") == []
    assert told(said + "world: {}\n") == ["lab.yaml:1: K931"]
    assert told("world:\n    tsaks: []\n", "lab.yaml") == ["lab.yaml:2: K931"]
    assert told("world:\n    tsaks: []\n", "another.yaml") == []
    (tmp_path / "start.yml").write_text(scene.replace("init_pos", "pos"), "utf-8")
    assert any(one.startswith(str(tmp_path / "start.yml")) for one in told(said))
    (tmp_path / "start.yml").unlink()
    assert [one.partition(": ")[2] for one in told(said)] == ["K901"]
    found = configuration_text("lab.yaml", tmp_path / "lab.yaml", site, lambda _: None)
    assert found is None  # what is on the disk does not say it
    main.write_text(said, "utf-8")
    found = configuration_text("lab.yaml", tmp_path / "lab.yaml", site, lambda _: None)
    assert found is not None
    assert (found.main.name, found.site) == ("app.yaml", found.source)


def test_a_change_of_the_site_is_told_in_the_configuration(tmp_path: Path) -> None:
    said = "# koord config check: --site lab.yaml\n" + TEXT
    lab = tmp_path / "lab.yaml"
    lab.write_text("seed: 1\n", "utf-8")
    (tmp_path / "app_two.yaml").write_text(said, "utf-8")

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            pair.open(pair.configuration, said, "yaml")
            assert await pair.newest(pair.configuration) == []
            pair.open(lab, "seed: 1\n", "yaml")
            pair.replace(lab, "params: {}\n")
            await editor.until(lambda: [d.code for d in pair.told(lab)] == ["K931"])  # in both
            await editor.until(lambda: len(pair.told(pair.configuration)) == 1)
            pair.replace(lab, "wor")
            at = types.Position(0, 3)
            found = await editor.client.text_document_completion_async(
                types.CompletionParams(identifier(lab.as_uri()), at)
            )
            assert isinstance(found, types.CompletionList)
            assert "world" in [one.label for one in found.items]
            pair.replace(lab, "seed: 1\n")
            await editor.until(lambda: pair.told(pair.configuration) == [])

    run(work())


def test_a_configuration_waits_for_no_program(tmp_path: Path) -> None:
    """However long its analysis takes."""
    goes_on = threading.Event()

    async def work() -> None:
        async with connected(AT_ONCE) as editor:
            pair = Pair(editor, tmp_path)
            editor.server.analysts.submit(goes_on.wait)
            pair.open(pair.program, PROGRAM, "koord")
            pair.open(pair.configuration, TEXT, "yaml")
            pair.replace(pair.configuration, TEXT + "sead: 1\n")
            (found,) = await pair.newest(pair.configuration)
            assert found.code == "K931"
            assert pair.told(pair.program) == []

    try:
        run(work())
    finally:
        goes_on.set()


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
