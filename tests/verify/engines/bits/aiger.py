"""Reading AIGER back, by its specification and not by what writes it; and running it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Aiger:
    """A file: literals of inputs, latches with what they become and start as, bad ones, ands."""

    inputs: list[int]
    latches: list[tuple[int, int, int]]
    bad: list[int]
    conjunctions: list[tuple[int, int, int]]
    names: dict[str, str]

    def step(self, state: Sequence[bool], inputs: Sequence[bool]) -> tuple[list[bool], list[bool]]:
        """The next state, and which bad literals hold now."""
        value = {0: False}
        value |= {x >> 1: b for x, b in zip(self.inputs, inputs, strict=True)}
        value |= {x >> 1: b for (x, _, _), b in zip(self.latches, state, strict=True)}

        def of(literal: int) -> bool:
            return value[literal >> 1] ^ bool(literal & 1)

        for left, a, b in self.conjunctions:
            assert left > a >= b, "each is made of what comes before"
            value[left >> 1] = of(a) and of(b)
        return [of(then) for _, then, _ in self.latches], [of(x) for x in self.bad]


def read(text: str) -> Aiger:
    lines = text.splitlines()
    header = lines[0].split()
    assert header[0] == "aag"
    largest, inputs, latches, outputs, ands, bad = map(int, header[1:])
    assert outputs == 0
    rows = [tuple(map(int, line.split())) for line in lines[1 : 1 + inputs + latches + bad + ands]]
    first = inputs + latches
    found = Aiger(
        [x for (x,) in rows[:inputs]],
        [(x, y, sum(reset)) for x, y, *reset in rows[inputs:first]],
        [x for (x,) in rows[first : first + bad]],
        [(x, y, z) for x, y, z in rows[first + bad :]],
        {},
    )
    defined = [
        *found.inputs,
        *(x for x, _, _ in found.latches),
        *(x for x, _, _ in found.conjunctions),
    ]
    assert len(set(defined)) == len(defined) == largest
    assert all(x % 2 == 0 and 0 < x <= 2 * largest for x in defined)
    for line in lines[1 + len(rows) :]:
        if line == "c":
            break
        key, name = line.split(" ", 1)
        found.names[key] = name
    return found


def read_binary(content: bytes) -> Aiger:
    """The same of the binary form: it is written out as the other one."""
    kind, *sizes = content.split(b"\n", 1)[0].split()
    assert kind == b"aig"
    largest, inputs, latches, outputs, ands, bad = map(int, sizes)
    assert (largest, outputs) == (inputs + latches + ands, 0)
    *head, rest = content.split(b"\n", 1 + latches + bad)
    lines = [f"aag {' '.join(str(int(size)) for size in sizes)}"]
    lines += [str(2 * n) for n in range(1, 1 + inputs)]
    states = zip(range(1 + inputs, 1 + inputs + latches), head[1:], strict=False)
    lines += [f"{2 * n} {then.decode()}" for n, then in states]
    lines += [str(int(literal)) for literal in head[1 + latches :]]
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            value |= (rest[at] & 0x7F) << shift
            shift, at = shift + 7, at + 1
            if rest[at - 1] < 0x80:
                return value

    for n in range(1 + inputs + latches, 1 + largest):
        left = 2 * n - number()
        lines.append(f"{2 * n} {left} {left - number()}")
    return read("\n".join(lines) + "\n" + rest[at:].decode())
