"""Loops of opaque values closed: what is new in a loop is called what it was at its start."""

from __future__ import annotations

from msgspec.structs import replace

from koord.semantics.recordings import Answer, Concrete, Recording
from koord.semantics.values import Rec, Seq, Table


def closing(loop: int, standing: list[dict[int, str]]) -> dict[str, str]:
    """What values are called that are new in a loop, by the names that they came up with."""
    first, last = standing[loop], standing[-1]
    old = {name for names in standing[: loop + 1] for name in names.values()}
    return {last[token]: first[token] for token in last if last[token] not in old}


def tied(lasso: Recording, names: dict[str, str]) -> Recording:
    """The lasso with opaque values that are new in the loop called what they were at its start.

    Of these nothing is known but what bits say, and they say the same at both ends. Whether any
    values are like that, replay finds out.
    """

    def called(value: Concrete) -> Concrete:
        match value:
            case Rec(fields=parts):
                return Rec(tuple(map(called, parts)))
            case Seq(length=length, items=items):
                return Seq(length, tuple(map(called, items)))
            case Table(length=length, entries=entries):
                return Table(length, tuple((called(k), called(v)) for k, v in entries))
            case str():
                return names.get(value, value)
            case _:
                return value

    def answered(answer: Answer) -> Answer:
        arguments = tuple(map(called, answer.arguments))
        return replace(answer, arguments=arguments, value=called(answer.value))

    rounds = tuple(
        replace(
            round_,
            readings=tuple(replace(r, value=called(r.value)) for r in round_.readings),
            answers=tuple(map(answered, round_.answers)),
        )
        for round_ in lasso.rounds
    )
    return replace(lasso, rounds=rounds)
