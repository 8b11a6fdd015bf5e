"""Lost updates: a robot's update of a variable meets another robot's write. [LOST-UPDATE]"""

from __future__ import annotations

from collections.abc import Iterator

from koord.recheck.rounds import Prefix
from koord.recheck.storage import AtKey, Field, Write
from koord.recheck.terms import Term
from koord.recheck.turns import EventTurn, Turns
from koord.recheck.values import Values
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.walk import nodes, statements


def lost(turns: Turns, prefix: Prefix, name: str) -> Term:
    """The condition that two robots write one location of a variable that one of them updates."""
    t = turns.v.t
    flat = [choice for mine in prefix.choices for choice in mine]
    return t.disjunction(
        t.conjunction([mine.runs, other.runs, meeting(turns.v, mine.turn, other.turn, name)])
        for mine in flat
        if name in set(updated(mine.turn.event.effect))
        for other in flat
        if other.turn.robot != mine.turn.robot
    )


def meeting(v: Values, one: EventTurn, other: EventTurn, name: str) -> Term:
    """The condition that two turns write one location of an allwrite variable."""
    mine, theirs = (
        [w for w in turn.writes if w.variable.home is Home.ALLWRITE and w.variable.name == name]
        for turn in (one, other)
    )
    return v.t.disjunction(_overlap(v, a, b) for a in mine for b in theirs)


def _overlap(v: Values, a: Write, b: Write) -> Term:
    """The condition that two writes happen, to locations one of which is a prefix of the other."""
    t, same = v.t, [a.when, b.when]
    for x, y in zip(a.locations, b.locations, strict=False):
        if isinstance(x, Field) or isinstance(y, Field):
            same.append(t.truth(x == y))
        elif isinstance(x, AtKey) or isinstance(y, AtKey):
            assert isinstance(x, AtKey)
            assert isinstance(y, AtKey)
            # Two that add entries of different keys decide about their order, and lose nothing.
            same.append(v.equal(x.key, y.key, x.type.key))
        else:
            same.append(t.equal(x, y))
    return t.conjunction(same)


def updated(effect: core.Block) -> Iterator[str]:
    """The allwrite variables that an effect updates outside of its atomic blocks."""
    flows = _flows(effect)
    for s in statements(effect, atomic=False):
        match s:
            case core.Assign(place=place, value=value) if place.variable.home is Home.ALLWRITE:
                if _keeps_the_rest(place) or any(
                    (read, place.variable) in flows or read == place.variable for read in _in(value)
                ):
                    yield place.variable.name
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.name
                if isinstance(s, core.Pop) and s.into is not None and _keeps_the_rest(s.into):
                    yield s.into.variable.name
            case _:
                pass


def _keeps_the_rest(place: core.Place) -> bool:
    """Return whether a write keeps the rest of a shared map's entry as it was read."""
    keys = [n for n, step in enumerate(place.steps, 1) if isinstance(step, core.KeyStep)]
    return place.variable.home is Home.ALLWRITE and keys != [] and keys[0] < len(place.steps)


def _flows(effect: core.Block) -> set[tuple[core.Variable, core.Variable]]:
    """Pairs of variables with a flow: the first is computed from the second."""
    pairs: set[tuple[core.Variable, core.Variable]] = set()
    for s in statements(effect):
        match s:
            case core.Assign(place=place, value=value) | core.Append(place=place, value=value):
                pairs |= {(place.variable, read) for read in _in(value)}
            case core.Pop(place=place, into=into) if into is not None:
                pairs.add((into.variable, place.variable))
            case core.ForEach(key=key, value=element, sequence=sequence):
                own = [v for v in (key, element) if v is not None]
                pairs |= {(v, read) for v in own for read in _in(sequence)}
            case _:
                pass
    while True:
        further = {(a, d) for a, b in pairs for c, d in pairs if b == c} - pairs
        if not further:
            return pairs
        pairs |= further


def _in(value: core.Expr) -> Iterator[core.Variable]:
    return (node.variable for node in nodes(value) if isinstance(node, core.Place))
