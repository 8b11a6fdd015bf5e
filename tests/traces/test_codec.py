"""Traces as JSON: exact in both directions, and hard to upset."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from msgspec.structs import replace

from koord.sampling.policies import AtRandom, First
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.faults import FaultKind
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.syntax.types import FLOAT, INT, ListType, MapType, Type
from koord.traces.codec import decode, encode, to_json
from koord.traces.form import SLACK, VERSION
from koord.traces.json_reader import FormError, JsonNode
from koord.traces.replay import replay
from koord.traces.trace import Numbers, Sources, Trace, Violation, ViolationKind, traced
from koord.traces.value_codec import decode_storage, decode_value, encode_storage, encode_value
from tests.generators.runs import recording
from tests.generators.strategies import systems
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.driving import NO_TEXT, drive, played
from tests.semantics.strategies import ROBOTS, storages, types, values

SCHEMA = json.loads(
    (Path(__file__).parents[2] / "koord/api/schemas/trace.schema.json").read_text("utf-8")
)
VALID = Draft202012Validator(SCHEMA)

TEXT = """\
param int most = 3
allwrite:
  int total = 0
local:
  bool done = false
Add:
  pre: not done
  eff:
    atomic: total = total + pid
    done = true
    stdout << "total " << total
invariant Bounded: total <= most
"""


def through(trace: Trace) -> Trace:
    """Encoded and decoded again."""
    program = trace.system.program
    return decode(encode(trace), "t.json", lambda sources: program)


def example(policy: str = "first") -> Trace:
    return played(programs.sum_of_ids(), First() if policy == "first" else AtRandom(Random(3)))[1]


# --- round trips --------------------------------------------------------------------------------


@given(data=st.data(), type_=types, numbers=st.sampled_from(Numbers))
@examples(300)
def test_values_come_back(data: st.DataObject, type_: Type, numbers: Numbers) -> None:
    """[TRACE] [VALUE]: through text, whatever the type."""
    value = data.draw(values(type_, numbers))
    text = json.dumps(encode_value(value, type_))
    back = decode_value(JsonNode(json.loads(text)), type_, ROBOTS, numbers)
    assert back == value


@given(data=st.data(), type_=types, numbers=st.sampled_from(Numbers))
@examples(200)
def test_storage_comes_back(data: st.DataObject, type_: Type, numbers: Numbers) -> None:
    """[TRACE] [ATOM]: unset atoms as such."""
    storage = data.draw(storages(type_, numbers))
    text = json.dumps(encode_storage(storage, type_))
    back = decode_storage(JsonNode(json.loads(text)), type_, ROBOTS, numbers)
    assert back == storage


@pytest.mark.parametrize("value", [0.1, 1e300, -0.0, math.inf, -math.inf, 5e-324])
def test_doubles_come_back_to_the_last_bit(value: float) -> None:
    """[TRACE] [DOMAIN]"""
    text = json.dumps(encode_value(value, FLOAT), allow_nan=False)
    back = decode_value(JsonNode(json.loads(text)), FLOAT, 1, Numbers.DOUBLE)
    assert repr(back) == repr(value)


def test_not_a_number_comes_back() -> None:
    """[TRACE] [DOMAIN]"""
    assert encode_value(math.nan, FLOAT) == "nan"
    back = decode_value(JsonNode("nan"), FLOAT, 1, Numbers.DOUBLE)
    assert isinstance(back, float)
    assert math.isnan(back)


def test_how_values_are_written() -> None:
    """[TRACE]: the documented forms."""
    trace = drive(programs.collections(), 2).round("Take", "Pop").trace()
    run: Any = to_json(trace)["run"]
    assert run["initial"]["robots"][0]["locals"]["mine"] == {
        "loc": {"x": {"#unset": None}, "y": {"#unset": None}, "z": {"#unset": None}},
        "assigned": {"#unset": None},
        "id": -1,
    }
    after = run["rounds"][0]["after"]
    assert after["store"]["allread"]["mode"] == ["pick", "idle"]
    assert after["store"]["allwrite"]["owner"] == [["a", -1], ["b", 0]]
    assert after["robots"][0]["locals"]["seen"] == ["1/3"]
    assert run["rounds"][0]["events"] == ["Take", "Pop"]
    assert run["rounds"][0]["output"] == [
        {"robot": 0, "stream": "stdout", "types": ["Mode", "int"], "values": ["pick", 0]}
    ]


@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
@given(seed=st.integers(0, 10**6))
@examples(6)
def test_traces_come_back(program: core.Program, numbers: Numbers, seed: int) -> None:
    """[TRACE]: recordings, configurations, output and violations; and the schema describes them."""
    rng = Random(seed)
    _, trace = played(program, AtRandom(rng), rounds=4, numbers=numbers, rng=rng)
    assert through(trace) == trace
    assert next(VALID.iter_errors(json.loads(encode(trace))), None) is None


@pytest.mark.parametrize("kind", FaultKind)
def test_faults_come_back(kind: FaultKind) -> None:
    """[TRACE] [FAULT]"""
    _, trace = played(programs.fault_demo(kind), First(), rounds=2)
    assert trace.configurations[-1].fault is not None
    assert through(trace) == trace
    assert next(VALID.iter_errors(json.loads(encode(trace))), None) is None


@given(system=systems(), seed=st.integers(0, 10**6))
@examples(40)
def test_traces_of_generated_programs_come_back(system: System, seed: int) -> None:
    """[TRACE] [RECORDING]: of programs that nobody thought of."""
    made = recording(Random(seed), system, 2)
    if made is None:
        return
    trace = traced(NO_TEXT, system, Numbers.EXACT, made)
    assert through(trace) == trace
    assert next(VALID.iter_errors(json.loads(encode(trace))), None) is None


def test_texts_and_settings_come_back() -> None:
    """[TRACE]: program, properties, params, tasks; and so does a claimed violation."""
    sources = Sources(
        Source("a.krd", "# π\n"),
        (Source("p.krd", ""),),
        (("n", 3), ("x", Fraction(1, 3)), ("b", True), ("s", "0x3"), ("l", (1, (Fraction(2),)))),
        ((Fraction(1), Fraction(1, 2), Fraction(0)),),
    )
    violation = Violation(ViolationKind.LOST_UPDATE, "total", 0, 2)
    trace = replace(example(), sources=sources, violation=violation)
    assert json.loads(encode(trace))["version"] == 1
    slack = replace(trace, slack=Fraction(1, 5))
    assert through(slack) == slack
    assert json.loads(encode(slack))["version"] == SLACK  # an older node would be too strict
    assert next(VALID.iter_errors(json.loads(encode(slack))), None) is None
    back = through(trace)
    assert back == trace
    assert [type(value) for _, value in back.sources.params] == [int, Fraction, bool, str, tuple]
    assert next(VALID.iter_errors(json.loads(encode(trace))), None) is None


def test_a_trace_is_self_contained() -> None:
    """[TRACE]: the program is made again from the text in the trace."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load

    source = Source("app.krd", TEXT)
    elaborated = load(source, Settings({"most": 5}))
    assert elaborated.program is not None
    _, trace = played(elaborated.program, First())
    trace = replace(trace, sources=Sources(source, (), (("most", 5),)))
    back = decode(encode(trace), "t.json")
    assert back == trace
    assert [(p.name, p.value) for p in back.system.program.parameters] == [("most", 5)]


# --- damage -------------------------------------------------------------------------------------


def refusals(raw: bytes, program: core.Program | None = None) -> list[tuple[str, str]]:
    """The codes and messages that a document is refused with."""
    made = program if program is not None else programs.sum_of_ids()
    with pytest.raises(KoordError) as caught:
        decode(raw, "t.json", lambda sources: made)
    assert all(d.span.file == "t.json" and d.hint for d in caught.value.diagnostics)
    return [(d.code, d.message) for d in caught.value.diagnostics]


def changed(change: Callable[[Any], object]) -> bytes:
    """An example of a trace with its JSON changed."""
    document = json.loads(encode(example()))
    change(document)
    return json.dumps(document).encode()


def put(*path: str | int, value: object) -> Callable[[Any], object]:
    def change(document: Any) -> None:
        for name in path[:-1]:
            document = document[name]
        document[path[-1]] = value

    return change


def drop(*path: str | int) -> Callable[[Any], object]:
    def change(document: Any) -> None:
        for name in path[:-1]:
            document = document[name]
        del document[path[-1]]

    return change


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "the file is empty"),
        (b"  \n", "the file is empty"),
        (b"koord", "it is no JSON"),
        (b'{"format": ', "cut off"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a": 1, "a": 2}', "'a' twice"),
        (b'{"a": NaN}', "NaN is no JSON"),
        (b"1" * 10_000, "thousands of digits"),
    ],
)
def test_what_is_no_json(raw: bytes, message: str) -> None:
    """[TRACE]"""
    ((code, text),) = refusals(raw)
    assert code == "K910"
    assert message in text


@pytest.mark.parametrize("raw", [b"{}", b"[]", b"3", b'{"format": "ITF"}', b'{"version": 1}'])
def test_json_that_is_no_trace(raw: bytes) -> None:
    """[TRACE]"""
    ((code, _),) = refusals(raw)
    assert code == "K911"


def test_a_trace_of_the_future() -> None:
    """[TRACE]"""
    ((code, message),) = refusals(changed(put("version", value=VERSION + 1)))
    assert code == "K912"
    assert f"version {VERSION + 1}" in message


@pytest.mark.parametrize(
    ("change", "code", "path"),
    [
        (put("version", value=True), "K913", "$"),
        (put("version", value=0), "K913", "$"),
        (drop("robots"), "K913", "$: the field 'robots'"),
        (put("extra", value=1), "K913", "$.extra"),
        (put("robots", value=[]), "K913", "$.robots"),
        (put("robots", value=[0, 0, 1]), "K914", "$"),
        (put("robots", 1, value=-1), "K913", "$.robots[1]"),
        (put("robots", value=3), "K913", "$.robots"),
        (put("delta", value="0"), "K913", "$.delta"),
        (put("delta", value="1/0"), "K913", "$.delta"),
        (put("delta", value=0.1), "K913", "$.delta"),
        (put("delta", value="9" * 5000), "K913", "$.delta"),
        (put("numbers", value="real"), "K913", "$.numbers"),
        (put("slack", value="-1"), "K913", "$.slack"),
        (put("slack", value=0.2), "K913", "$.slack"),
        (put("params", value={"x": None}), "K913", "$.params.x"),
        (put("params", value={"x": {"int": "1/2"}}), "K913", "$.params.x.int"),
        (put("tasks", value=[["1", "2"]]), "K913", "$.tasks[0]"),
        (put("program", "text", value="changed"), "K915", "$.program.text"),
        (put("program", "name", value=None), "K913", "$.program.name"),
        (put("run", "opening", "order", 0, value=3), "K913", "$.run.opening.order[0]"),
        (put("run", "rounds", 1, "events", 0, value="Sub"), "K914", "$.run.rounds[1].events[0]"),
        (put("run", "rounds", 1, "events", value=[]), "K913", "$.run.rounds[1].events"),
        (put("run", "rounds", 0, "cut", value=0), "K913", "$.run.rounds[0].cut"),
        (drop("run", "rounds", 0, "after"), "K913", "$.run.rounds[0]"),
        (
            put("run", "initial", "store", "allwrite", "total", value="zero"),
            "K913",
            "$.run.initial.store.allwrite.total",
        ),
        (
            put("run", "initial", "robots", 2, "locals", "done", value=1),
            "K913",
            "$.run.initial.robots[2].locals.done",
        ),
        (put("run", "initial", "robots", value=[]), "K913", "$.run.initial.robots"),
        (put("run", "initial", "robots", 0, "status", value="idle"), "K913", ".status"),
        (put("run", "initial", "turn", value="both"), "K913", "$.run.initial.turn"),
        (put("run", "initial", "taken", value=[-1]), "K913", "$.run.initial.taken[0]"),
        (put("run", "initial", "fault", value={}), "K913", "$.run.initial.fault"),
        (
            put("run", "rounds", 0, "output", 0, "types", 0, value="pos"),
            "K914",
            "$.run.rounds[0].output[0].types[0]",
        ),
        (put("run", "violation", value={"kind": "x"}), "K913", "$.run.violation"),
        (
            put(
                "run",
                "opening",
                "answers",
                value=[
                    {
                        "phase": "init",
                        "robot": 0,
                        "key": [1],
                        "function": "f",
                        "arguments": [],
                        "value": 0,
                    }
                ],
            ),
            "K914",
            "$.run.opening.answers[0].function",
        ),
        (
            put(
                "run",
                "opening",
                "starts",
                value=[{"home": "bound", "variable": "x", "robot": 0, "value": 0}],
            ),
            "K913",
            "$.run.opening.starts[0].home",
        ),
    ],
)
def test_damage_is_named_with_its_place(
    change: Callable[[Any], object], code: str, path: str
) -> None:
    """[TRACE]: the JSON path of the first thing that is wrong."""
    ((found, message),) = refusals(changed(change))
    assert found == code
    assert path in message


def test_a_map_with_a_key_twice() -> None:
    """[TRACE] [VALUE]"""
    node = JsonNode([[1, 2], [1, 3]])
    with pytest.raises(FormError, match="has this key already"):
        decode_value(node, MapType(INT, INT), 1, Numbers.EXACT)


@pytest.mark.parametrize(
    ("value", "numbers"),
    [
        ("1.5", Numbers.EXACT),
        ("1/-2", Numbers.EXACT),
        ("", Numbers.EXACT),
        ("٣", Numbers.EXACT),
        ("0x" + "f" * 10**6, Numbers.EXACT),
        (1.5, Numbers.EXACT),
        ("Infinity", Numbers.DOUBLE),
        (True, Numbers.DOUBLE),
        (10**400, Numbers.DOUBLE),
        (None, Numbers.DOUBLE),
    ],
)
def test_odd_numbers_are_refused(value: object, numbers: Numbers) -> None:
    """[TRACE] [DOMAIN]"""
    with pytest.raises(FormError):
        decode_value(JsonNode(value), FLOAT, 1, numbers)


def test_a_trace_cut_off_anywhere_is_refused() -> None:
    """[TRACE]: cut at every tenth byte, and no traceback."""
    raw = encode(example())
    for end in range(0, len(raw) - 3, 10):
        refusals(raw[:end])


def test_a_program_that_has_errors_now() -> None:
    """[TRACE]: the errors are told with their places in the text."""
    trace = replace(example(), sources=Sources(Source("old.krd", "local:\n  int x = y\n")))
    with pytest.raises(KoordError) as caught:
        decode(encode(trace), "t.json")
    first, second = caught.value.diagnostics
    assert (first.code, first.span.file) == ("K916", "old.krd")
    assert (second.span.line, second.span.column) == (2, 11)


_junk = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-3, 10**20),
        st.floats(allow_nan=False, allow_infinity=False),
        st.sampled_from(["", "Add", "0x", "1/0", "env", "int", "allread", "#unset", "nan"]),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=4,
)


def _paths(part: object, at: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    found = [at]
    if isinstance(part, dict):
        for name, value in part.items():
            found += _paths(value, (*at, name))
    elif isinstance(part, list):
        for position, value in enumerate(part):
            found += _paths(value, (*at, position))
    return found


_EXAMPLES = [
    (program, json.loads(encode(played(program, AtRandom(Random(5)), rounds=2)[1])))
    for program in (
        programs.collections(),
        programs.rover(),
        programs.thermostat(),
        programs.external_planner(),
    )
]


@given(data=st.data(), which=st.sampled_from(range(len(_EXAMPLES))))
@examples(400)
def test_whatever_is_changed_nothing_crashes(data: st.DataObject, which: int) -> None:
    """[TRACE] [REPLAY]: a changed trace is refused, or is one, and then replay has an answer."""
    program, document = _EXAMPLES[which]
    document = json.loads(json.dumps(document))
    path = data.draw(st.sampled_from([p for p in _paths(document) if p]))
    change = put(*path, value=data.draw(_junk)) if data.draw(st.booleans()) else drop(*path)
    change(document)
    try:
        trace = decode(json.dumps(document).encode(), "t.json", lambda sources: program)
    except KoordError:
        return
    found = replay(trace)
    assert found.refused is not None or through(trace) == trace


def test_lists_of_any_length_are_read() -> None:
    """[VALUE]"""
    node = JsonNode([1, 2, "0x20000000000000"])
    back = decode_value(node, ListType(INT), 1, Numbers.EXACT)
    assert encode_value(back, ListType(INT)) == [1, 2, "0x20000000000000"]
