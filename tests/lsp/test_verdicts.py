"""Verdicts while somebody types: lenses, marks, counterexamples, cancellation."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types
from pygls.exceptions import JsonRpcException

from koord.lsp.server import COUNTEREXAMPLE
from koord.lsp.verifying import Verified
from tests.lsp.connected import CAPABILITIES, URI, Editor, connected, run

COUNTER = """\
allwrite:
    int total = 0
local:
    int own = 0
Go:
    pre: own < 2
    eff:
        own = own + 1
        atomic: total = total + 1
invariant Small: forall i: own@i <= 2
invariant Few: total <= 3
invariant Empty: false implies total == 7
"""
SETTINGS = {"verify": {"robots": 2, "rounds": 6, "cache": False, "delayS": 0, "jobs": 1}}


def kinds(told: Any) -> dict[str, str]:
    return {mark.name: mark.kind for mark in told.marks}


async def lenses(editor: Editor) -> dict[int, types.Command]:
    found = await editor.client.text_document_code_lens_async(types.CodeLensParams(editor.document))
    assert found is not None
    return {lens.range.start.line: lens.command for lens in found if lens.command is not None}


def test_verdicts_are_shown_as_what_they_are() -> None:
    async def work() -> None:
        async with connected(SETTINGS) as editor:
            editor.open(COUNTER)
            told = await editor.verified()
            assert kinds(told)["Small"] == "holds"
            assert kinds(told)["Few"] == "violated"
            assert kinds(told)["Empty"] == "vacuous"
            assert {mark.name: mark.line for mark in told.marks}["Few"] == 10
            shown = await lenses(editor)
            assert shown[9].title.startswith("✓ Small holds in every round · 2 robots")
            assert shown[10].title.startswith("✗ Few is violated in round")
            assert shown[11].title.startswith("∅ Empty holds, but says nothing")
            await editor.until(lambda: len(editor.diagnostics) > 1)
            found = {(d.code, d.range.start.line) for d in editor.diagnostics[-1].diagnostics}
            assert ("violated", 10) in found
            assert ("vacuous", 11) in found

    run(work())


def test_verdicts_come_one_by_one() -> None:
    """What breaks is shown, and its run, while others are still being asked about."""

    async def work() -> None:
        async with connected(SETTINGS | {"traceView": True}) as editor:
            editor.open(COUNTER)
            await editor.verified()
            going = [told for told in editor.verdicts if told.state == "verifying"]
            settled = [{mark.name for mark in told.marks} for told in going]
            assert settled[0] == set()
            assert any("Few" in names for names in settled)
            # never fewer than before, and nothing twice
            assert all(old <= new for old, new in pairwise(settled))
            assert all(len(told.marks) == len({mark.name for mark in told.marks}) for told in going)
            assert not any(mark.stale for told in going for mark in told.marks)

    run(work())


def test_a_run_that_breaks_a_claim_is_shown_before_all_is_settled() -> None:
    async def work() -> None:
        async with connected(SETTINGS) as editor:
            editor.open(COUNTER)
            done = await editor.verified()
            text = editor.server.texts[URI]
            (mark,) = (mark for mark in done.marks if mark.name == "Few")
            complete = text.verified
            assert complete is not None
            # as it is after the verdict on Few, and with no older verdicts
            text.settled = Verified(
                tuple(one for one in complete.marks if one.name == "Few"),
                (),
                complete.report,
                done=False,
            )
            text.is_verifying, text.verified = True, None
            shown = await lenses(editor)
            assert shown[10].title == f"{mark.title} · show the run"
            assert shown[9].title == "… verifying"
            assert editor.server.counterexample(URI, "Few")["text"].startswith("# Few is violated")
            editor.server._publish(text, editor.version)
            await editor.until(
                lambda: {d.code for d in editor.diagnostics[-1].diagnostics} == {"violated"}
            )

    run(work())


def test_a_counterexample_is_one_click_away() -> None:
    async def work() -> None:
        async with connected(SETTINGS | {"traceView": True}) as editor:
            editor.open(COUNTER)
            await editor.verified()
            command = (await lenses(editor))[10]
            assert command.command == COUNTEREXAMPLE
            await editor.client.workspace_execute_command_async(
                types.ExecuteCommandParams(command.command, command.arguments)
            )
            await editor.until(lambda: editor.traces)
            (trace,) = editor.traces
            assert trace.claim == "Few"
            assert trace.text.startswith("# Few is violated")
            assert "| Go |" in trace.text
            assert "total: 3 → 4" in trace.text
            assert trace.html.lower().startswith("<!doctype html")
            assert '"format"' in trace.trace or '"koord' in trace.trace
            with pytest.raises(JsonRpcException, match="no counterexample"):
                await editor.client.workspace_execute_command_async(
                    types.ExecuteCommandParams(COUNTEREXAMPLE, [URI, "Small"])
                )

    run(work())


def test_a_client_that_shows_no_traces_gets_a_file() -> None:
    async def work() -> None:
        async with connected(SETTINGS) as editor:
            editor.open(COUNTER)
            await editor.verified()
            await editor.client.workspace_execute_command_async(
                types.ExecuteCommandParams(COUNTEREXAMPLE, [URI, "Few"])
            )
            await editor.until(lambda: editor.messages)
            path = Path(editor.messages[0].rpartition(" ")[2])
            assert path.read_text("utf-8").startswith("# Few is violated")
        assert not path.exists()

    run(work())


def test_a_change_ends_what_is_going_on() -> None:
    """Only the newest text gets verdicts, however fast somebody types."""

    async def work() -> None:
        async with connected(SETTINGS) as editor:
            editor.open(COUNTER)
            for most in (9, 8, 7, 6, 5, 4):
                editor.replace(COUNTER.replace("total <= 3", f"total <= {most}"))
            told = await editor.verified()
            assert kinds(told)["Few"] == "holds"
            assert {v.version for v in editor.verdicts if v.state == "done"} <= {
                editor.version,
                0,
            }

    run(work())


def test_what_comes_late_is_not_shown() -> None:
    """A verification may be over just before the change that would have ended it."""

    async def work() -> None:
        async with connected({"verify": {**SETTINGS["verify"], "on": "never"}}) as editor:
            editor.open(COUNTER)
            editor.replace(COUNTER)
            await editor.checked()
            text = editor.server.texts[URI]
            editor.server._verified(text, editor.version - 1, Verified(refused="of the older text"))
            assert text.verified is None
            editor.server._verified(text, editor.version, Verified(refused="of the newest"))
            assert (await editor.verified("refused")).reason == "of the newest"

    run(work())


def test_old_verdicts_are_said_to_be_old_and_move_with_their_claims() -> None:
    async def work() -> None:
        async with connected(SETTINGS) as editor:
            editor.open(COUNTER)
            await editor.verified()
            editor.replace("# more\n" + COUNTER.replace("own = own + 1", "own = own + +"))
            assert [d.code for d in await editor.checked()] != []
            told = await editor.verified("errors")
            marks = {mark.name: mark for mark in told.marks}
            assert marks["Few"].stale
            assert marks["Few"].line == 11
            shown = await lenses(editor)
            assert "before the last change" in shown[11].title
            assert shown[11].command == ""

    run(work())


def test_verification_is_stopped_and_asked_for() -> None:
    async def work() -> None:
        async with connected({"verify": {**SETTINGS["verify"], "on": "never"}}) as editor:
            editor.open(COUNTER)
            await editor.checked()
            assert editor.verdicts == []
            for command in ("koord.verify", "koord.cancelVerification"):
                await editor.client.workspace_execute_command_async(
                    types.ExecuteCommandParams(command, [URI])
                )
            await editor.verified("cancelled")
            await editor.client.workspace_execute_command_async(
                types.ExecuteCommandParams("koord.verify", [URI])
            )
            assert kinds(await editor.verified())["Few"] == "violated"

    run(work())


def test_what_cannot_be_verified_says_why() -> None:
    async def work() -> None:
        settings = {"verify": {**SETTINGS["verify"], "robots": 100_000}}
        async with connected(settings) as editor:
            editor.open(COUNTER)
            told = await editor.verified("refused")
            assert "robots" in told.reason
            assert told.marks == []

    run(work())


def test_an_unknown_verdict_says_so() -> None:
    text = (
        "def fun odd(int x) -> bool: extern\nlocal:\n  int x = 0\nGo:\n  eff: x = x + 1\n"
        "invariant Odd: odd(x) implies x < 3\n"
    )

    async def work() -> None:
        settings = {"verify": {**SETTINGS["verify"], "rounds": 1, "timeoutS": 0.01}}
        async with connected(settings, CAPABILITIES) as editor:
            editor.open(text)
            told = await editor.verified()
            assert kinds(told)["Odd"] in ("unknown", "violated", "bounded")
            marks = {mark.name: mark for mark in told.marks}
            if kinds(told)["Odd"] == "unknown":
                assert marks["Odd"].title.startswith("? Odd is unknown")

    run(work())
