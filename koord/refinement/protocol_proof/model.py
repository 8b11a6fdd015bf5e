"""The round-commit protocol for every number of robots: relations, axioms, and actions.

What is modelled is the set of all that was ever said, which only grows, and what it says about the
next thing that a robot may say. So a crash is no step of the model, and neither is a return: a
robot with its journal has said what it has said (R-RESUME), one without it is another life, that
has said nothing (R-REJOIN). Loss, delay and repetition are no steps either.
"""

from __future__ import annotations

from koord.refinement.protocol_proof.logic import (
    Action,
    Effect,
    Equal,
    Exists,
    ForAll,
    Formula,
    Not,
    Relation,
    Sort,
    Variable,
    becomes,
    both,
    either,
    implies,
    statement,
)

_L, _E, _H, _Q = Sort.LIFE, Sort.EPOCH, Sort.HISTORY, Sort.QUORUM

#: Lives, epochs, quorums.
i, j, v, w = (Variable(name, _L) for name in "ijvw")
e, f, x, y, a = (Variable(name, _E) for name in "efxya")
q, r = (Variable(name, _Q) for name in "qr")

#: Histories. Of a coordinator: ``d`` is what it had committed when it first stood, ``c`` when it
#: took office; ``b`` is what it held then: ``c``, or ``c`` and a tentative entry.
h, g, k, p, b, c, d = (Variable(name, _H) for name in "hgkpbcd")

#: The history on which all robots begin; the first epoch; and COMMITTED, above all epochs.
ROOT = Variable("root", _H)
ZERO = Variable("zero", _E)
EVER = Variable("ever", _E)
CONSTANTS = (ROOT, ZERO, EVER)

# --- what does not change -------------------------------------------------------------------------

earlier = Relation("earlier", (_E, _E))
prefix = Relation("prefix", (_H, _H))  #: or the same
no_longer = Relation("no_longer", (_H, _H))  #: has at most as many entries as
parent = Relation("parent", (_H, _H))  #: all but the last entry of
among = Relation("among", (_L, _Q))
on_roster = Relation("on_roster", (_H, _L))  #: counts after this history
majority = Relation("majority", (_Q, _H))  #: consists of a majority, of the roster after this
enough = Relation("enough", (_Q, _H))  #: may commit this history (R-MAJORITY)
same_robot = Relation("same_robot", (_L, _L))
owns = Relation("owns", (_L, _E))  #: the epoch belongs to its robot
lawful = Relation("lawful", (_H,))  #: its last entry is what R-DECIDE makes of proposals

# --- what was said, and what follows from it ------------------------------------------------------

decides = Relation("decides", (_L, _E, _H))  #: Decide, and by whom
decided = Relation("decided", (_E, _H))
acknowledged = Relation("acknowledged", (_L, _E, _H))
candidate = Relation("candidate", (_L, _E, _H))  #: Candidacy, and what it had committed
reached = Relation("reached", (_L, _E, _H, _E))  #: a Candidacy for it told this position, or more
voted = Relation("voted", (_L, _E, _L))
left = Relation("left", (_L, _E))  #: has promised a higher epoch
office = Relation("office", (_L, _E, _H, _H, _H))  #: took office in it, with b, c and d
base = Relation("base", (_E, _H, _H))  #: somebody took office in it, with b and c
seated = Relation("seated", (_L, _E))
taken = Relation("taken", (_E,))
chosen = Relation("chosen", (_E, _H))  #: enough lives acknowledged it in this epoch
committed = Relation("committed", (_H,))  #: a robot has acted on it

STATE = (
    decides,
    decided,
    acknowledged,
    candidate,
    reached,
    voted,
    left,
    office,
    base,
    seated,
    taken,
    chosen,
    committed,
)


def no_later(first: Variable, second: Variable) -> Formula:
    return Not(earlier(second, first))


def within(h: Variable, x: Variable, b: Variable, a: Variable) -> Formula:
    """The position (h, x) is at most (b, a): fewer entries, or as many, and no later epoch."""
    return either(Not(no_longer(b, h)), both(no_longer(h, b), no_later(x, a)))


AXIOMS = (
    # Epochs are in a row.
    statement("irreflexive", Not(earlier(e, e))),
    statement("transitive", earlier(e, f), earlier(f, x), earlier(e, x)),
    statement("total", either(earlier(e, f), earlier(f, e), Equal(e, f))),
    statement("first", either(earlier(ZERO, e), Equal(e, ZERO))),
    statement("last", either(earlier(e, EVER), Equal(e, EVER))),
    # Histories are a tree: one digest stands for all before it.
    statement("prefix reflexive", prefix(h, h)),
    statement("prefix transitive", prefix(h, g), prefix(g, k), prefix(h, k)),
    statement("prefix antisymmetric", prefix(h, g), prefix(g, h), Equal(h, g)),
    statement("no joins", prefix(h, k), prefix(g, k), either(prefix(h, g), prefix(g, h))),
    statement("root", prefix(ROOT, h)),
    statement("length transitive", no_longer(h, g), no_longer(g, k), no_longer(h, k)),
    statement("length total", either(no_longer(h, g), no_longer(g, h))),
    statement("prefixes are shorter", prefix(h, g), no_longer(h, g)),
    statement("prefixes of a length", prefix(h, g), no_longer(g, h), Equal(h, g)),
    statement("a parent is a prefix", parent(p, h), both(prefix(p, h), Not(Equal(p, h)))),
    statement("the last prefix", parent(p, h), prefix(k, h), either(Equal(k, h), prefix(k, p))),
    statement("shorter by one", parent(p, h), either(no_longer(k, p), no_longer(h, k))),
    # A majority is ⌊N/2⌋ + 1 of the N lives of a roster (``proving.majorities_meet``).
    statement(
        "majorities meet",
        majority(q, h),
        majority(r, h),
        Exists((w,), both(among(w, q), among(w, r))),
    ),
    statement("counted by the roster before", enough(q, h), parent(p, h), majority(q, p)),
    # Incarnations go up.
    statement("one counts", on_roster(h, i), on_roster(h, j), same_robot(i, j), Equal(i, j)),
    statement(
        "none comes back",
        *(prefix(h, g), prefix(g, k), on_roster(h, i), on_roster(k, i)),
        on_roster(g, i),
    ),
    statement("an epoch has one owner", owns(i, e), owns(j, e), same_robot(i, j)),
)

#: What else is true of histories. A proof names those for which it needs it, as otherwise each
#: history would beget another.
PARENT = either(Equal(h, ROOT), parent(p, h))
CHILD = implies(prefix(c, h), either(Equal(c, h), both(parent(c, k), prefix(k, h))))

# --- actions --------------------------------------------------------------------------------------


def _promises(life: Variable, epoch: Variable) -> Effect:
    return Effect(left, (w, x), both(Equal(w, life), earlier(x, epoch)))


def _settled(history: Variable, epoch: Variable, when: Variable) -> Formula:
    """The history was chosen when the epoch's coordinator could know."""
    return either(Equal(history, ROOT), both(no_later(when, epoch), chosen(when, history)))


def _puts(i: Variable, e: Variable, h: Variable) -> tuple[Effect, ...]:
    """The coordinator holds what it decides."""
    facts = (decides(i, e, h), decided(e, h), acknowledged(i, e, h))
    return (*map(becomes, facts), _promises(i, e))


#: How a run begins, from nothing: epoch 0 needs no election.
START = Action(
    "start",
    "R-ENTER",
    (i,),
    (on_roster(ROOT, i), owns(i, ZERO), earlier(ZERO, EVER)),
    tuple(
        map(
            becomes,
            (
                office(i, ZERO, ROOT, ROOT, ROOT),
                base(ZERO, ROOT, ROOT),
                candidate(i, ZERO, ROOT),
                seated(i, ZERO),
                taken(ZERO),
                committed(ROOT),
            ),
        )
    ),
)

ACTIONS = (
    Action(
        "stand",
        "R-STAND",
        (i, e, b, a, d, y),
        (
            earlier(e, EVER),
            owns(i, e),
            Not(left(i, e)),
            on_roster(d, i),
            either(Equal(d, ROOT), both(earlier(y, e), chosen(y, d))),
            ForAll((h, x), implies(acknowledged(i, x, h), within(h, x, b, a))),
        ),
        (
            becomes(candidate(i, e, d)),
            becomes(voted(i, e, i)),
            _promises(i, e),
            Effect(reached, (w, f, h, x), both(Equal(w, i), Equal(f, e), within(h, x, b, a))),
        ),
    ),
    Action(
        "vote",
        "R-VOTE",
        (v, e, i),
        (
            voted(i, e, i),
            Not(left(v, e)),
            ForAll((h, x), implies(acknowledged(v, x, h), reached(i, e, h, x))),
        ),
        (becomes(voted(v, e, i)), _promises(v, e)),
    ),
    Action(
        "take office",
        "R-OFFICE",
        (i, e, b, a, c, d, y, q),
        (
            candidate(i, e, d),
            Not(seated(i, e)),
            Not(left(i, e)),
            earlier(e, EVER),
            prefix(d, c),
            on_roster(c, i),
            _settled(c, e, y),
            either(
                both(Equal(a, EVER), Equal(b, c)),
                both(earlier(a, e), decided(a, b), parent(c, b)),
            ),
            majority(q, c),
            majority(q, b),
            ForAll((v,), implies(among(v, q), voted(v, e, i))),
            ForAll((h, x), implies(reached(i, e, h, x), within(h, x, b, a))),
        ),
        tuple(
            map(becomes, (office(i, e, b, c, d), base(e, b, c), seated(i, e), taken(e))),
        ),
    ),
    Action(
        "put forward again",
        "R-OFFICE",
        (i, e, h, c, d),
        (office(i, e, h, c, d), Not(Equal(h, c)), Not(left(i, e))),
        _puts(i, e, h),
    ),
    Action(
        "decide",
        "R-DECIDE",
        (i, e, h, b, c, d, p, y),
        (
            office(i, e, b, c, d),
            Not(left(i, e)),
            parent(p, h),
            prefix(b, p),
            on_roster(p, i),
            _settled(p, e, y),
            lawful(h),
            ForAll((g,), implies(decides(i, e, g), prefix(g, p))),
        ),
        _puts(i, e, h),
    ),
    Action(
        "accept",
        "R-ACCEPT",
        (v, e, h),
        (decided(e, h), Not(left(v, e))),
        (becomes(acknowledged(v, e, h)), _promises(v, e)),
    ),
    Action(
        "choose",
        "R-MAJORITY",
        (e, h, q),
        (
            decided(e, h),
            enough(q, h),
            ForAll((v,), implies(among(v, q), acknowledged(v, e, h))),
        ),
        (becomes(chosen(e, h)),),
    ),
    Action("commit", "R-COMMIT", (e, h), (chosen(e, h),), (becomes(committed(h)),)),
)
