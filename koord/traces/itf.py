"""Traces as ITF, the Informal Trace Format that tools for TLA+ read (Apalache, ADR-015).

One state per step: INIT, each program turn, each turn of the environment. Locals and ports are
functions of the robot. What the step was is the variable ``step``; the order of the robots in the
round stands in the state's ``#meta``. The trace itself travels in the document's ``#meta``, so that
what was exported can be replayed.

    int            {"#bigint": "3"}               float, unset   {"#unserializable": "3/4"}
    enumeration    "idle"                         record         {"x": …, "y": …}
    list, array    […]                            map            {"#map": [[key, value], …]}
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Step, execute
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import Cell, Storage
from koord.syntax.diagnostics import refusal
from koord.syntax.system import Status
from koord.syntax.types import (
    ArrayType,
    EnumType,
    FloatType,
    MapType,
    SetType,
    Type,
)
from koord.traces.codec import Load, decode_document, to_json
from koord.traces.json_reader import FormError, JsonNode
from koord.traces.names import Named, Names, distinct
from koord.traces.trace import Trace
from koord.traces.value_codec import Form, Json, encode_value

#: Where the document's ``#meta`` holds the trace.
EMBEDDED = "koord"

_ADR = "https://apalache-mc.org/docs/adr/015adr-trace.html"

_OF_STEPS = ("status", "ran", "round", "turn", "step")


# --- export -------------------------------------------------------------------------------------


def encode_itf(trace: Trace) -> bytes:
    """A trace as an ITF document. Raises IllegalStepError if it cannot be run step by step."""
    exporting = _Exporting(trace)
    head: dict[str, Json] = {
        "#meta": {
            "format": "ITF",
            "format-description": _ADR,
            "source": trace.sources.program.name,
            "description": "A run of a Koord program",
            EMBEDDED: to_json(trace),
        },
        "vars": list[Json](exporting.variables),
    }
    if trace.recording.loop is not None:
        head["loop"] = exporting.looped(trace.recording.loop)
    states = ",\n".join(json.dumps(state) for state in exporting.states())
    text = json.dumps(head)[:-1] + f', "states": [\n{states}\n]}}\n'
    return text.encode("utf-8")


class _Exporting:
    """The export of a trace to ITF: the variables' ITF names, and the states."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self.names = Names(trace.system)
        self.of_robots = list(dict.fromkeys(self._of_robots()))
        shared = [n.name for n in (*self.names.allread, *self.names.allwrite)]
        every = distinct([*_OF_STEPS, *shared, *(_identifier(n) for n in self.of_robots)])
        self.variables = every
        rest = every[len(_OF_STEPS) :]
        self.shared = dict(zip(range(len(shared)), rest, strict=False))
        self.own = dict(zip(self.of_robots, rest[len(shared) :], strict=True))

    @property
    def older(self) -> dict[str, str]:
        """Map the names that older documents use to the variables' names."""
        ports = (named for kind in self.names.kinds for named in kind.ports)
        return {_identifier(n.older): self.own[n.name] for n in ports if n.older != n.name}

    def _of_robots(self) -> Iterator[str]:
        """Name the locals and ports of all kinds of robot."""
        for kind in self.names.kinds:
            yield from (n.name for n in kind.locals)
            yield from (n.name for n in kind.ports)

    def states(self) -> Iterator[dict[str, Json]]:
        """Yield one ITF state per step."""
        trace = self.trace
        orders = [list[Json](round_.order) for round_ in trace.recording.rounds]
        steps = execute(trace.numbers.domain, trace.system, trace.recording)
        for index, step in enumerate(steps):
            order = orders[step.round] if step.round >= 0 else trace.recording.opening.order
            yield {"#meta": {"index": index, "order": list[Json](order)}, **self._state(step)}

    def looped(self, loop: int) -> int:
        """The number of the state to which a lasso's last state returns, up to round and step.
        [LASSO]
        """
        rounds = self.trace.recording.rounds[:loop]
        return sum(len(round_.order) + (not round_.cut) for round_ in rounds)

    def _state(self, step: Step) -> dict[str, Json]:
        configuration = step.configuration
        fault = configuration.fault
        state: dict[str, Json] = {
            "status": self._function(
                Status(int(str(r.status))).name.lower() for r in configuration.robots
            ),
            "ran": self._function(
                "" if r.ran == NO_EVENT else self.names.of(i).events[int(str(r.ran))]
                for i, r in enumerate(configuration.robots)
            ),
            "round": _integer(configuration.round),
            "turn": configuration.turn.value,
            "step": {
                "rule": step.rule,
                "robot": _integer(-1 if step.robot is None else step.robot),
                "event": step.event or "",
                "fault": "" if fault is None else fault.kind.value,
            },
        }
        state.update(self._variables(configuration))
        return state

    def _variables(self, configuration: Configuration[Constant]) -> Iterator[tuple[str, Json]]:
        store = configuration.store
        shared = [
            *zip(self.names.allread, store.allread, strict=True),
            *zip(self.names.allwrite, store.allwrite, strict=True),
        ]
        for position, (named, storage) in enumerate(shared):
            allread = position < len(self.names.allread)
            value = _of_entries(named, storage) if allread else itf_storage(storage, named.type)
            yield self.shared[position], value
        held: dict[str, list[Json]] = {name: [] for name in self.of_robots}
        for number, robot in enumerate(configuration.robots):
            own = self.names.of(number)
            pairs = [
                *zip(own.locals, robot.locals, strict=True),
                *zip(own.ports, robot.ports, strict=True),
            ]
            for named, storage in pairs:
                held[named.name].append([_integer(number), itf_storage(storage, named.type)])
        for name, entries in held.items():
            yield self.own[name], {"#map": entries}

    @staticmethod
    def _function(values: Iterator[str]) -> Json:
        return {"#map": [[_integer(i), value] for i, value in enumerate(values)]}


def _of_entries(named: Named, storage: Storage[Constant]) -> Json:
    """Encode an allread variable as a function from robots to their entries."""
    assert not isinstance(storage, Cell)
    assert isinstance(named.type, ArrayType)
    element = named.type.element
    entries = (itf_storage(part, element) for part in storage.parts)
    return {"#map": [[_integer(i), entry] for i, entry in enumerate(entries)]}


def _identifier(name: str) -> str:
    """Turn ``Motion.psn`` into ``Motion_psn``: names in TLA+ have no dots."""
    return name.replace(".", "_")


def _integer(value: int) -> Json:
    return {"#bigint": str(value)}


def _scalar(value: Constant, type_: Type) -> Json:
    encoded = encode_value(value, type_)
    if isinstance(type_, FloatType):
        return {"#unserializable": str(encoded)}
    if isinstance(encoded, bool) or isinstance(type_, EnumType) or isinstance(value, str):
        return encoded
    assert isinstance(value, int)
    return {"#bigint": _decimal(value)}


def _table(type_: MapType, pairs: list[tuple[Json, Json]]) -> Json:
    if isinstance(type_, SetType):
        return {"#set": [key for key, _ in pairs]}
    return {"#map": [[key, held] for key, held in pairs]}


_FORM = Form(_scalar, _table, {"#unserializable": "unset"})

itf_value = _FORM.value
itf_storage = _FORM.storage


def _decimal(value: int) -> str:
    """Convert an integer to decimal, however long: Python's own conversion has a limit."""
    if value.bit_length() < 10_000:
        return str(value)
    half = 10 ** (value.bit_length() // 7)
    high, low = divmod(abs(value), half)
    digits = len(_decimal(half)) - 1
    return f"{'-' if value < 0 else ''}{_decimal(high)}{_decimal(low).rjust(digits, '0')}"


# --- import -------------------------------------------------------------------------------------


def is_itf(document: object) -> bool:
    """Return whether a JSON document is in ITF, whichever tool wrote it."""
    return isinstance(document, dict) and "vars" in document and "states" in document


def embedded_trace(document: dict[str, Any], name: str, load: Load | None = None) -> Trace:
    """Decode the trace embedded in an ITF document that koord wrote. Raises KoordError.

    The states must be those of the run that is carried along: whoever reads them in another tool
    has to see what was replayed.
    """
    meta = document.get("#meta")
    if not isinstance(meta, dict) or EMBEDDED not in meta:
        raise refusal(
            "K917",
            name,
            "this ITF document was not written by koord: it holds states, but no recording",
            "name a file that `koord run --trace x.itf.json` wrote",
        )
    trace = decode_document(meta[EMBEDDED], name, load, f"$.#meta.{EMBEDDED}")
    try:
        _compare(trace, JsonNode(document))
    except FormError as error:
        raise error.refusal(name, "$") from None
    except IllegalStepError:
        pass  # the replay says where
    return trace


def _compare(trace: Trace, document: JsonNode) -> None:
    """Check states against the run. Raises FormError, or IllegalStepError if the run is illegal."""
    parts = dict(document.entries())
    loop = trace.recording.loop
    given_loop = parts["loop"].value if "loop" in parts else None
    exporting = _Exporting(trace)
    if given_loop != (None if loop is None else exporting.looped(loop)):
        raise document.refuse("the field 'loop' is not that of the recording", "K917")
    expected = [json.loads(json.dumps(state)) for state in exporting.states()]
    states = parts["states"].items(len(expected))
    for number, (state, given) in enumerate(zip(expected, states, strict=True)):
        if state != given.value and state != _renamed(given.value, exporting.older):
            name = _first_difference(state, given)
            raise given.refuse(
                f"state {number} is not the one that the recording leads to (see {name})", "K917"
            )


def _renamed(state: object, older: dict[str, str]) -> object:
    """Rename a state's variables from the names that older documents use."""
    if not isinstance(state, dict):
        return state
    return {older.get(name, name): value for name, value in state.items()}


def _first_difference(expected: dict[str, Json], given: JsonNode) -> str:
    found = given.value if isinstance(given.value, dict) else {}
    return next((name for name in expected if expected[name] != found.get(name)), "its fields")
