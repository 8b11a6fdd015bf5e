"""Where one robot's update of a variable meets another robot's write. [LOST-UPDATE]"""

from __future__ import annotations

from collections.abc import Iterator

from koord.recheck.body import Write
from koord.recheck.rounds import Prefix
from koord.recheck.storage import Field
from koord.recheck.terms import Term
from koord.recheck.turns import Turns
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.walk import nodes


def meeting(turns: Turns, prefix: Prefix, name: str) -> Term:
    """Whether two robots write one location of the variable, and the event of one updates it."""
    t = turns.v.t
    flat = [choice for mine in prefix.choices for choice in mine]
    found = []
    for mine in flat:
        if name not in set(updated(mine.turn.event.effect)):
            continue
        for other in flat:
            if other.turn.robot == mine.turn.robot:
                continue
            both = t.both(mine.runs, other.runs)
            for a in mine.turn.writes:
                for b in other.turn.writes:
                    if a.variable.name == b.variable.name == name and _shared(a) and _shared(b):
                        found.append(t.both(both, _overlap(turns, a, b)))
    return t.disjunction(found)


def _shared(w: Write) -> bool:
    return w.variable.home is Home.ALLWRITE


def _overlap(turns: Turns, a: Write, b: Write) -> Term:
    """One location is a prefix of the other."""
    t = turns.v.t
    same = [a.when, b.when]
    for x, y in zip(a.locations, b.locations, strict=False):
        if isinstance(x, Field) or isinstance(y, Field):
            same.append(t.truth(x == y))
        else:
            same.append(t.equal(x, y))
    return t.conjunction(same)


def updated(block: core.Block) -> Iterator[str]:
    """The allwrite variables that a block updates outside of its atomic blocks."""
    for s in block:
        match s:
            case core.Assign(place=place, value=value) if place.variable.home is Home.ALLWRITE:
                if any(node == place.variable for node in nodes(value)):
                    yield place.variable.name
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.name
            case core.If(then=then, otherwise=otherwise):
                yield from updated(then)
                yield from updated(otherwise)
            case core.ForRange(body=body) | core.ForEach(body=body):
                yield from updated(body)
            case _:
                pass
