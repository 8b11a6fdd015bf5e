"""Ports of the library go by two names: what shows a run has the one that the program uses."""

from __future__ import annotations

import json
from random import Random

import pytest

from koord.refinement.cases import SchedulePolicy
from koord.refinement.running import ready
from koord.sampling.monitors import Monitor
from koord.sampling.policies import First, Play
from koord.sampling.running import new_run
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.traces.codec import decode, encode
from koord.traces.itf import embedded_trace, encode_itf
from koord.traces.json_reader import parse
from koord.traces.names import Names
from koord.traces.replay import replay
from koord.traces.trace import Numbers, Sources, Trace, traced
from tests.refinement.running import agrees, ran

BODY = (
    "local:\n  int n = 0\n  pos at\nGo:\n  pre: {done}\n  eff:\n    at = {place}\n    n = n + 1\n"
)


def program_text(head: str, place: str = "position", done: str = "done or n < 9") -> str:
    return f"using Motion{head}\n" + BODY.format(place=place, done=done)


OWN = ":\n  sensors:\n    pos {}\n    bool {}"

CASES = {
    "published": (program_text(""), ["Motion.position", "Motion.done"]),
    "kept": (program_text("", "psn", "reached or n < 9"), ["Motion.psn", "Motion.reached"]),
    "mixed": (
        program_text("", "Motion.position", "reached"),
        ["Motion.position", "Motion.reached"],
    ),
    "both": (
        program_text("", "psn", "(done or reached) and psn.x < 9.0 and position.x < 5.0"),
        ["Motion.psn", "Motion.done"],
    ),
    "both, the other way": (
        program_text("", "psn", "(reached or done) and position.x < 9.0 and reached"),
        ["Motion.position", "Motion.reached"],
    ),
    "declared": (program_text(OWN.format("position", "done")), ["Motion.position", "Motion.done"]),
    "declared otherwise": (
        program_text(OWN.format("position", "reached"), "psn"),
        ["Motion.position", "Motion.reached"],
    ),
    "in a property": (
        program_text("", "pos(0.0, 0.0, 0.0)", "n < 3")
        + "invariant Low: forall i: position@i.z < 9.0\n",
        ["Motion.position"],
    ),
}


def trace_of(text: str) -> Trace:
    source = Source("app.krd", text)
    program = load(source).program
    assert program is not None
    run = new_run(dealt(program, 2), Numbers.EXACT, Random(0))
    play = Play(run, First(), 3, Monitor(run.d, run.system, run.inputs))
    list(play.steps())
    return traced(Sources(source), run.system, Numbers.EXACT, play.recording())


@pytest.mark.parametrize("name", CASES)
def test_ports_are_named_as_in_the_program(name: str) -> None:
    text, labels = CASES[name]
    trace = trace_of(text)
    (kind,) = Names(trace.system).kinds
    assert [port.name for port in kind.ports] == labels
    kept = json.loads(encode(trace))["run"]
    assert list(kept["initial"]["robots"][0]["ports"]) == labels
    assert {reading["port"] for reading in kept["rounds"][0]["readings"]} == set(labels)
    (of_kind,) = ready(trace.system.program).classes
    assert [port.replace("_", ".") for port in of_kind.PORTS] == labels
    assert replay(decode(encode(trace), "t.json")).refused is None


def test_traces_with_the_names_that_are_kept_are_read() -> None:
    """Those that were written before ports were named as programs name them."""
    trace = trace_of(CASES["published"][0])
    for data, read in ((encode(trace), decode), (encode_itf(trace), read_itf)):
        older = data
        for new, old in (("position", "psn"), ("done", "reached")):
            for between in (".", "_"):
                older = older.replace(
                    f"Motion{between}{new}".encode(), f"Motion{between}{old}".encode()
                )
        assert older != data
        found = read(older, "older.json")
        assert found == trace
        assert replay(found).refused is None


def read_itf(raw: bytes, name: str) -> Trace:
    return embedded_trace(parse(raw, name), name)


@pytest.mark.parametrize("policy", SchedulePolicy)
def test_compiled_programs_read_ports_by_either_name(policy: SchedulePolicy) -> None:
    for text, _ in CASES.values():
        agrees(ran(text, robots=2, policy=policy))
