"""Traces that grow are pieces of the whole; pieces of traces are read up to the last round."""

from __future__ import annotations

import io
from fractions import Fraction
from random import Random

import pytest
from msgspec.structs import replace

from koord.api.traces import read_trace
from koord.sampling.policies import AtRandom
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.traces.codec import encode, load_embedded
from koord.traces.replay import replay
from koord.traces.trace import Sources, Trace
from koord.traces.unfinished import GrowingTrace, completed, mended
from tests.semantics.driving import played

TEXT = """\
allwrite:
  int total = 0
local:
  int x = 0
Add:
  eff:
    atomic: total = total + 1
    x = x + total
    stdout << "\\"rounds\\": [" << total
invariant Counted: total >= 0
"""

END = b'\n ],\n "violation": null\n}\n}\n'


@pytest.fixture(scope="module")
def whole() -> Trace:
    sources = Sources(Source("sum.krd", TEXT))
    system = System(load_embedded(sources), (0, 0), Fraction(1))
    policy, rng = AtRandom(Random(3)), Random(3)
    _, trace = played(system.program, policy, rounds=6, rng=rng, system=system)
    return replace(trace, sources=sources)


def until(trace: Trace, rounds: int) -> Trace:
    """The run up to the end of a round."""
    recording = replace(trace.recording, rounds=trace.recording.rounds[:rounds])
    outputs = tuple(one for one in trace.outputs if one.round < rounds)
    configurations = trace.configurations[: rounds + 1]
    return replace(trace, recording=recording, outputs=outputs, configurations=configurations)


@pytest.mark.parametrize("steps", [(0, 1, 2, 3, 4, 5, 6), (0, 6), (6,), (2, 2, 5, 6)])
def test_what_grows_is_the_text_of_the_whole(whole: Trace, steps: tuple[int, ...]) -> None:
    """[TRACE]"""
    file = io.BytesIO()
    part = GrowingTrace(file)
    for rounds in steps:
        part.grow(until(whole, rounds))
        made = mended(file.getvalue())
        assert made is not None
        assert read_trace(made, "t", None) == until(whole, rounds)
        assert completed(file.getvalue(), whole) == encode(whole)
        assert completed(file.getvalue(), until(whole, rounds)) == encode(until(whole, rounds))
    assert completed(b"", whole) == encode(whole)
    assert file.getvalue() + END == encode(whole)


def test_a_text_that_ends_anywhere_has_the_rounds_that_are_whole(whole: Trace) -> None:
    """[TRACE] [REPLAY]"""
    raw = encode(whole)
    lines = raw.splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if line == b' "rounds": [\n') + 1
    ends = [len(b"".join(lines[: first + k])) for k in range(7)]  # behind so many rounds
    for at in Random(1).sample(range(len(raw) - 2), 60) + [
        end + by for end in ends for by in (-3, -2, -1, 0, 1)
    ]:
        # The line break and the comma behind a round are none of it.
        rounds = sum(at >= end - (2 if k < 6 else 1) for k, end in enumerate(ends) if k)
        if at < ends[0] - 1:
            assert mended(raw[:at]) is None
            continue
        found = read_trace(raw[:at], "t", None)
        assert found == replace(until(whole, rounds), cut_off=True), at
        assert replay(found).refused is None


def test_a_whole_trace_is_not_cut_off(whole: Trace) -> None:
    raw = encode(whole)
    assert mended(raw) is None
    assert mended(raw.rstrip()) is None
    assert mended(b"") is None
    assert not read_trace(raw, "t", None).cut_off
