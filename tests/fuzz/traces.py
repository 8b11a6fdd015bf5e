"""What holds of any bytes that are read as a trace, and traces varied value by value."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import redirect_stdout
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

from koord.api.traces import read_trace
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.diagnostics import KoordError
from koord.traces.codec import decode, encode
from koord.traces.replay import replay

NAME = "fuzzed.json"
SEED = Path(__file__).parent / "seed.krd"

#: A trace that was varied may ask for many robots; replaying them takes long, and shows no more.
MOST_ROBOTS = 8


def examine(data: bytes) -> None:
    """Read, encode anew and replay. Raises if any of that raises anything but a diagnostic."""
    try:
        trace = read_trace(data, NAME, None)
    except KoordError as error:
        for diagnostic in error.diagnostics:
            assert diagnostic.code.startswith("K")
            assert diagnostic.message
        return
    written = encode(trace)
    assert encode(decode(written, NAME)) == written
    if len(trace.system.kinds) <= MOST_ROBOTS:
        replay(trace)


def write_seeds(folder: Path) -> None:
    """Write the traces that fuzzing begins with: both forms, exact and double, whole and broken."""
    runs = (
        ("exact.json", "--robots=2", "--rounds=3"),
        ("exact.itf.json", "--robots=2", "--rounds=2", "--policy=random"),
        ("double.json", "--robots=2", "--rounds=2", "--numbers=double", "--policy=random"),
        ("fault.json", "--robots=2", "--rounds=3", "--set=divisor=0"),
        ("violated.json", "--robots=3", "--rounds=3", "--set=most=1"),
    )
    for name, *flags in runs:
        path = folder / name
        with redirect_stdout(io.StringIO()):
            code = main(["run", str(SEED), *flags, "--trace", str(path)])
        assert code in (Exit.OK, Exit.VIOLATED), (name, code)


# --- variations ---------------------------------------------------------------------------------

_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 10**30, 0.5, "", "0", "1/2", "-3", "1/0", "x", "E", "\ud800"),
    *([], {}, [[]], [0, 0], {"int": "3"}, {"float": "1/3"}, {"#bigint": "7"}, {"#map": [[1, 2]]}),
)


def varied(data: bytes, random: Random) -> bytes:
    """The trace with a few of its values replaced, taken out, or put elsewhere."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return data[: random.randint(0, len(data))]
    for _ in range(random.randint(1, 4)):
        places = list(_places(document))
        if places:
            _vary(*random.choice(places), places, random)
    return json.dumps(document).encode("utf-8")


#: An object or array, and a key or position in it.
_Place = tuple[Any, Any]


def _places(document: object) -> Iterator[_Place]:
    waiting = [document]
    while waiting:
        node = waiting.pop()
        match node:
            case dict():
                keys: list[Any] = list(node)
            case list():
                keys = list(range(len(node)))
            case _:
                continue
        for key in keys:
            yield node, key
            waiting.append(node[key])


def _vary(node: Any, key: Any, places: list[_Place], random: Random) -> None:
    old = node[key]
    match random.randrange(5):
        case 0:
            del node[key]
        case 1:
            other, there = random.choice(places)
            node[key] = deepcopy(other[there]) if there in _keys(other) else None
        case 2 if isinstance(old, int) and not isinstance(old, bool):
            node[key] = old + random.choice((-1, 1))
        case 3 if isinstance(node, list):
            node.insert(key, deepcopy(old))
        case 4 if isinstance(node, dict):
            node[random.choice((key + "x", "", "run", "value"))] = deepcopy(old)
        case _:
            node[key] = deepcopy(random.choice(_VALUES))


def _keys(node: Any) -> Any:
    return node if isinstance(node, dict) else range(len(node))
