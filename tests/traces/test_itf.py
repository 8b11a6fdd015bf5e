"""Traces as ITF: what the format asks for, and back again."""

from __future__ import annotations

import json
import re
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.sampling.policies import AtRandom, First
from koord.semantics.recordings import Concrete
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.faults import FaultKind
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, FLOAT, INT, POS, STRING, ListType, MapType, Type
from koord.traces.codec import encode
from koord.traces.itf import embedded_trace, encode_itf, is_itf, itf_value
from koord.traces.json_reader import parse
from koord.traces.replay import replay
from koord.traces.trace import Numbers, Trace, traced
from tests.generators.runs import recording
from tests.generators.strategies import systems
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.building import TRUE, Build
from tests.semantics.driving import NO_TEXT, drive, played


def document(trace: Trace) -> Any:
    return json.loads(encode_itf(trace))


def back(raw: bytes, program: core.Program) -> Trace:
    return embedded_trace(parse(raw, "t.itf.json"), "t.itf.json", lambda sources: program)


def expressions(part: object) -> list[object]:
    """Every expression of a state, outermost first."""
    found = [part]
    if isinstance(part, dict):
        for value in part.values():
            found += expressions(value)
    elif isinstance(part, list):
        for value in part:
            found += expressions(value)
    return found


SPECIAL = {"#bigint", "#map", "#set", "#tup", "#unserializable"}


def check_form(made: Any) -> None:
    """The rules of ADR-015: every state has every variable; no JSON numbers; marks stand alone."""
    assert made["#meta"]["format"] == "ITF"
    assert set(made) == {"#meta", "vars", "states"}
    assert len(set(made["vars"])) == len(made["vars"])
    for index, state in enumerate(made["states"]):
        assert state["#meta"]["index"] == index
        variables = {name: value for name, value in state.items() if name != "#meta"}
        assert list(variables) == made["vars"]
        for expression in expressions(variables):
            assert isinstance(expression, str | bool | list | dict)
            if isinstance(expression, dict) and SPECIAL & set(expression):
                assert len(expression) == 1
                ((mark, content),) = expression.items()
                if mark == "#bigint":
                    assert re.fullmatch(r"-?[0-9]+", content)
                if mark == "#map":
                    assert all(len(pair) == 2 for pair in content)
                if mark == "#unserializable":
                    assert isinstance(content, str)


@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
def test_runs_have_the_form_and_come_back(program: core.Program, numbers: Numbers) -> None:
    """[TRACE]: the whole trace travels in ``#meta``, and replays."""
    rng = Random(4)
    _, trace = played(program, AtRandom(rng), rounds=3, numbers=numbers, rng=rng)
    raw = encode_itf(trace)
    check_form(json.loads(raw))
    again = back(raw, program)
    assert again == trace
    assert replay(again).refused is None


@given(system=systems(), seed=st.integers(0, 10**6))
@examples(25)
def test_generated_runs_have_the_form_and_come_back(system: System, seed: int) -> None:
    """[TRACE] [RECORDING]"""
    made = recording(Random(seed), system, 2)
    if made is not None:
        trace = traced(NO_TEXT, system, Numbers.EXACT, made)
        raw = encode_itf(trace)
        check_form(json.loads(raw))
        assert back(raw, system.program) == trace


def test_states_are_steps() -> None:
    """[EVENT-TRANS]: one state per step, labelled with rule, robot, event and order."""
    d = drive(programs.sum_of_ids(), 2).skip(1).go(0, "Add").env()
    made = document(d.trace())
    steps = [(s["step"]["rule"], s["step"]["robot"], s["step"]["event"]) for s in made["states"]]
    number = [{"#bigint": str(k)} for k in (-1, 0, 1)]
    assert steps == [
        ("INIT", number[0], ""),
        ("SKIP", number[2], ""),
        ("EVENT-TRANS", number[1], "Add"),
        ("ENV-TRANS", number[0], ""),
    ]
    assert [s["#meta"]["order"] for s in made["states"]] == [[0, 1], [1, 0], [1, 0], [1, 0]]
    assert [s["total"] for s in made["states"]] == [number[1]] * 4
    done = [[pair[1] for pair in s["done"]["#map"]] for s in made["states"]]
    assert done == [[False, False], [False, False], [True, False], [True, False]]
    assert made["states"][2]["ran"]["#map"] == [[number[1], "Add"], [number[2], ""]]


def test_locals_and_ports_are_functions_of_the_robot() -> None:
    """[CONFIG]: of those robots that have them; names are identifiers."""
    made = document(drive(programs.two_kinds(), 3).round("Drive", "Climb", None).trace())
    last = made["states"][-1]
    robots = [{"#bigint": str(k)} for k in range(3)]
    assert [pair[0] for pair in last["fuel"]["#map"]] == [robots[0], robots[2]]
    assert last["Rotor_up"] == {"#map": [[robots[1], {"#unserializable": "1/10"}]]}
    assert last["height"]["#map"][1] == [robots[1], {"#unserializable": "1/10"}]
    assert all(re.fullmatch(r"\w+", name) for name in made["vars"])


def test_names_that_clash_are_told_apart() -> None:
    """[TRACE]: a variable may be called like a label, or like another's port."""
    b = Build()
    b.allwrite("step", INT, 1)
    b.local("round", INT, 2)
    b.local("Unit_x", INT, 3)
    b.sensor("x", INT, 4)
    b.module("Unit", [])
    b.event("Nothing", TRUE)
    made = document(drive(b.program(), 1).trace())
    check_form(made)
    state = made["states"][0]
    assert state["step#2"] == {"#bigint": "1"}
    assert state["round#2"]["#map"][0][1] == {"#bigint": "2"}
    assert state["Unit_x"]["#map"][0][1] == {"#bigint": "3"}
    assert state["Unit_x#2"]["#map"][0][1] == {"#bigint": "4"}


_VALUES: list[tuple[Concrete, Type, object]] = [
    (-3, INT, {"#bigint": "-3"}),
    (10**5000, INT, {"#bigint": "1" + "0" * 5000}),
    (True, BOOL, True),
    ("a", STRING, "a"),
    (2, programs.MODE, "drop"),
    (0.25, FLOAT, {"#unserializable": "0.25"}),
    (Rec((1, 2, 3)), POS, {n: {"#unserializable": str(k)} for k, n in enumerate("xyz", start=1)}),
    (Seq(1, (5,)), ListType(INT), [{"#bigint": "5"}]),
    (
        Table(1, (("k", 7),)),
        MapType(STRING, INT),
        {"#map": [["k", {"#bigint": "7"}]]},
    ),
]


@pytest.mark.parametrize(("value", "type_", "expected"), _VALUES, ids=range(len(_VALUES)))
def test_values_in_itf(value: Concrete, type_: Type, expected: object) -> None:
    """[VALUE]"""
    assert itf_value(value, type_) == expected


def test_unset_atoms_are_marked() -> None:
    """[ATOM]"""
    made = document(drive(programs.collections(), 1).trace())
    assert made["states"][0]["mine"]["#map"][0][1]["assigned"] == {"#unserializable": "unset"}


def test_a_run_into_a_fault() -> None:
    """[FAULT]: the last state says which."""
    _, trace = played(programs.fault_demo(FaultKind.KEY), First(), rounds=2)
    made = document(trace)
    assert made["states"][-1]["step"]["fault"] == "missing map key"
    assert back(encode_itf(trace), trace.system.program) == trace


# --- what is not ours ---------------------------------------------------------------------------


def refused(raw: bytes) -> tuple[str, str]:
    with pytest.raises(KoordError) as caught:
        back(raw, programs.sum_of_ids())
    (found,) = caught.value.diagnostics
    return found.code, found.message


def test_itf_of_other_tools_is_refused() -> None:
    """[TRACE]: it has states, but no recording."""
    foreign: dict[str, object] = {
        "#meta": {"format": "ITF"},
        "vars": ["x"],
        "states": [{"x": {"#bigint": "1"}}],
    }
    nothing: dict[str, object] = {"vars": [], "states": []}
    for made in (foreign, nothing, {**foreign, "#meta": 3}):
        raw = json.dumps(made).encode()
        assert is_itf(parse(raw, "t"))
        code, message = refused(raw)
        assert code == "K917"
        assert "no recording" in message
    assert not is_itf(parse(encode(drive(programs.sum_of_ids()).trace()), "t"))


def test_states_that_were_changed_are_refused() -> None:
    """[TRACE]: what other tools show must be what is replayed."""
    trace = drive(programs.sum_of_ids(), 2).round("Add", None).trace()
    made = document(trace)
    made["states"][1]["total"] = {"#bigint": "40"}
    code, message = refused(json.dumps(made).encode())
    assert code == "K917"
    assert "$.states[1]: state 1 is not the one that the recording leads to (see total)" in message
    made = document(trace)
    del made["states"][2]
    assert refused(json.dumps(made).encode())[0] in ("K913", "K917")
    made = document(trace)
    made["#meta"]["koord"]["version"] = 99
    assert refused(json.dumps(made).encode())[0] == "K912"


def test_a_recording_that_is_not_legal_is_left_to_replay() -> None:
    """[REPLAY]"""
    trace = drive(programs.late_violation(), 2).round("Count", None).trace()
    made = document(trace)
    made["#meta"]["koord"]["run"]["rounds"][0]["order"] = [0, 0]
    found = replay(back(json.dumps(made).encode(), trace.system.program)).refused
    assert found is not None
    assert found.rule == "EVENT-TRANS"


def test_kinds_may_use_a_name_for_two_types() -> None:
    """[CONFIG]"""
    b = Build()
    b.agent("A")
    b.local("x", INT, 1)
    b.event("Nothing", TRUE)
    b.agent("B")
    b.local("x", BOOL, True)
    b.event("Nothing", TRUE)
    system = dealt(b.program(), 2)
    made = document(replace(drive(b.program(), 2).trace(), system=system))
    assert [pair[1] for pair in made["states"][0]["x"]["#map"]] == [{"#bigint": "1"}, True]
