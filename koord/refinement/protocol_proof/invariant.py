"""The inductive invariant of the model, and the claims that follow from it.

The invariant holds at the beginning and is kept by each action; a claim follows from statements
before it. That makes them true after any number of steps (``proving`` has Z3 say so).
"""

from __future__ import annotations

from msgspec import Struct

from koord.refinement.protocol_proof.logic import (
    Equal,
    Exists,
    ForAll,
    Formula,
    Not,
    Variable,
    both,
    either,
    implies,
    statement,
)
from koord.refinement.protocol_proof.model import (
    EVER,
    ROOT,
    ZERO,
    acknowledged,
    among,
    b,
    base,
    c,
    candidate,
    chosen,
    committed,
    d,
    decided,
    decides,
    e,
    earlier,
    enough,
    f,
    g,
    h,
    i,
    j,
    k,
    lawful,
    left,
    majority,
    no_later,
    office,
    on_roster,
    owns,
    p,
    parent,
    prefix,
    q,
    reached,
    seated,
    taken,
    v,
    voted,
    w,
    x,
)

#: What another coordinator of the same epoch took office with.
_b, _c, _d = (Variable(f"{name}2", b.sort) for name in "bcd")


def _chosen_by(history: Variable, epoch: Variable) -> Formula:
    """The history was chosen in this epoch at the latest."""
    return either(Equal(history, ROOT), Exists((x,), both(no_later(x, epoch), chosen(x, history))))


def _chosen_before(history: Variable, epoch: Variable) -> Formula:
    return either(Equal(history, ROOT), Exists((x,), both(earlier(x, epoch), chosen(x, history))))


def _never_chosen(epoch: Variable, history: Variable) -> Formula:
    """One of each majority has left the epoch without acknowledging the history in it."""
    gone = both(among(w, q), left(w, epoch), Not(acknowledged(w, epoch, history)))
    return ForAll((q,), implies(enough(q, history), Exists((w,), gone)))


def _all(body: Formula) -> Formula:
    """Of each life of the quorum q."""
    return ForAll((v,), implies(among(v, q), body))


INVARIANT = (
    # What is said has been said by somebody.
    statement("an acknowledged entry was decided", acknowledged(i, e, h), decided(e, h)),
    statement("who decides has decided", decides(i, e, h), decided(e, h)),
    statement("somebody decided", decided(e, h), Exists((i,), decides(i, e, h))),
    statement("who decides is in office", decides(i, e, h), seated(i, e)),
    statement("an epoch of decisions is taken", decided(e, h), taken(e)),
    statement("an entry is lawful", decided(e, h), lawful(h)),
    # Promises.
    statement("a vote promises", voted(v, e, i), earlier(x, e), left(v, x)),
    statement("an acknowledgement promises", acknowledged(v, e, h), earlier(x, e), left(v, x)),
    statement(
        "a vote knew of what was acknowledged",
        *(acknowledged(v, x, h), voted(v, e, i), earlier(x, e)),
        reached(i, e, h, x),
    ),
    # Who is in office.
    statement(
        "a candidate counts",
        candidate(i, e, d),
        both(on_roster(d, i), owns(i, e), _chosen_before(d, e)),
    ),
    statement(
        "a coordinator counts",
        office(i, e, b, c, d),
        both(candidate(i, e, d), prefix(d, c), on_roster(c, i), seated(i, e), base(e, b, c)),
    ),
    statement("an epoch of coordinators is taken", base(e, b, c), taken(e)),
    statement("who is in office took it", seated(i, e), Exists((b, c, d), office(i, e, b, c, d))),
    statement(
        "office is taken once",
        *(office(i, e, b, c, d), office(i, e, _b, _c, _d)),
        both(Equal(b, _b), Equal(c, _c), Equal(d, _d)),
    ),
    statement(
        "a coordinator holds an entry more at most",
        base(e, b, c),
        both(earlier(e, EVER), either(Equal(b, c), both(parent(c, b), lawful(b)))),
    ),
    statement("its history was chosen", base(e, b, c), _chosen_by(c, e)),
    statement(
        "a majority elected it",
        base(e, b, c),
        either(
            Equal(e, ZERO),
            Exists(
                (q,),
                both(
                    *(majority(q, c), majority(q, b)),
                    ForAll((v, x), implies(among(v, q), earlier(x, e), left(v, x))),
                ),
            ),
        ),
    ),
    # Entries.
    statement(
        "decisions go on from what was held",
        *(office(i, e, b, c, d), decides(i, e, h)),
        both(
            prefix(b, h),
            either(
                Equal(h, b),
                ForAll((p,), implies(parent(p, h), both(prefix(b, p), on_roster(p, i)))),
            ),
        ),
    ),
    statement(
        "decisions have a coordinator",
        decided(e, h),
        Exists((b, c), both(base(e, b, c), prefix(b, h))),
    ),
    statement(
        "rounds before were chosen",
        *(decided(e, h), prefix(k, h)),
        either(Equal(k, h), _chosen_by(k, e)),
    ),
    statement("a chosen entry was decided", chosen(e, h), decided(e, h)),
    statement(
        "a majority acknowledged it",
        chosen(e, h),
        Exists((q,), both(enough(q, h), _all(acknowledged(v, e, h)))),
    ),
    statement(
        "what robots act on was chosen",
        committed(h),
        either(Equal(h, ROOT), Exists((e,), chosen(e, h))),
    ),
    # The heart: what a coordinator lacks is not chosen in an earlier epoch, now or later.
    statement(
        "a coordinator holds what may be chosen",
        *(decided(e, h), base(f, b, c), earlier(e, f)),
        either(prefix(h, b), _never_chosen(e, h)),
    ),
    # An epoch may have two coordinators, if a robot stood for it in two lives. The older one held
    # the entry that admits the newer one, and decides nothing else.
    statement(
        "two coordinators of an epoch",
        *(office(i, e, b, c, d), office(j, e, _b, _c, _d)),
        either(
            Equal(i, j),
            both(Equal(b, _d), Not(on_roster(_d, i))),
            both(Equal(_b, d), Not(on_roster(d, j))),
        ),
    ),
    statement(
        "their decisions are one history",
        *(office(i, e, b, c, d), office(j, e, _b, _c, _d), decides(i, e, h), decides(j, e, g)),
        either(prefix(h, g), prefix(g, h)),
    ),
)

#: What follows from the invariant, in this order.
CLAIMS = (
    statement("I-ONE-ENTRY", decided(e, h), decided(e, g), either(prefix(h, g), prefix(g, h))),
    statement(
        "later epochs hold what may be chosen",
        *(decided(e, h), decided(f, g), earlier(e, f)),
        either(prefix(h, g), _never_chosen(e, h)),
    ),
    statement("I-LASTING", chosen(e, h), base(f, b, c), earlier(e, f), prefix(h, b)),
    statement(
        "who can commit has left, or the round is chosen",
        *(base(f, b, c), earlier(e, f), _chosen_by(p, e), majority(q, p)),
        either(
            Exists((w,), both(among(w, q), left(w, e))),
            Exists((k, x), both(parent(p, k), prefix(k, c), no_later(x, e), chosen(x, k))),
        ),
    ),
    statement("I-AGREE", committed(h), committed(g), either(prefix(h, g), prefix(g, h))),
    statement(
        "I-ACT",
        committed(h),
        either(
            Equal(h, ROOT),
            Exists((e, q), both(enough(q, h), _all(acknowledged(v, e, h)))),
        ),
    ),
    statement("committed entries are lawful", committed(h), either(Equal(h, ROOT), lawful(h))),
)

# --- how it is proved -----------------------------------------------------------------------------


class Guide(Struct, frozen=True):
    """What Z3 is told of one proof: nothing that could make it wrong, only shorter.

    ``only``: the statements of the invariant that it needs, if not those without ``SHY`` ones;
    ``besides``: shy ones that it needs; ``claims``: proved before; ``after``: statements and claims
    that were proved of the state after the action; ``children``: for these c and h, PARENT's and
    CHILD's histories exist; the variables of the goal have a prime.
    """

    only: tuple[str, ...] = ()
    besides: tuple[str, ...] = ()
    claims: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    children: tuple[tuple[str, str], ...] = ()
    parents: tuple[str, ...] = ()


#: Statements of something that exists: used only where they are asked for.
SHY = (
    "somebody decided",
    "who is in office took it",
    "decisions have a coordinator",
)

#: By action (``""``: of claims) and statement.
GUIDES = {
    ("take office", "a coordinator holds what may be chosen"): Guide(
        only=(
            "a vote promises",
            "a vote knew of what was acknowledged",
            "rounds before were chosen",
            "a chosen entry was decided",
            "a majority acknowledged it",
            "a coordinator holds what may be chosen",
        ),
        claims=("I-ONE-ENTRY", "later epochs hold what may be chosen"),
        children=(("c", "h'"), ("c to h'", "h'")),
    ),
    ("take office", "two coordinators of an epoch"): Guide(
        only=(
            "a candidate counts",
            "a coordinator counts",
            "a coordinator holds an entry more at most",
            "two coordinators of an epoch",
        ),
        claims=("I-LASTING",),
        after=("I-LASTING",),
    ),
    **{
        (action, "their decisions are one history"): Guide(
            only=(
                "office is taken once",
                "decisions go on from what was held",
                "two coordinators of an epoch",
                "a coordinator counts",
                "a coordinator holds an entry more at most",
                "their decisions are one history",
            ),
            parents=("h'", "g'"),
        )
        for action in ("decide", "put forward again")
    },
    **{
        (action, "a coordinator holds what may be chosen"): Guide(
            only=(
                "an acknowledged entry was decided",
                "an acknowledgement promises",
                "a chosen entry was decided",
                "a coordinator counts",
                "a coordinator holds an entry more at most",
                "its history was chosen",
                "decisions go on from what was held",
                "a coordinator holds what may be chosen",
            ),
            claims=("I-LASTING", "who can commit has left, or the round is chosen"),
            after=("I-ONE-ENTRY",),
        )
        for action in ("decide", "put forward again")
    },
    ("", "I-ONE-ENTRY"): Guide(
        only=(
            "somebody decided",
            "who decides is in office",
            "who is in office took it",
            "their decisions are one history",
        )
    ),
    ("", "later epochs hold what may be chosen"): Guide(
        only=("decisions have a coordinator", "a coordinator holds what may be chosen")
    ),
    ("", "I-LASTING"): Guide(
        only=(
            "a chosen entry was decided",
            "a majority acknowledged it",
            "a coordinator holds what may be chosen",
        )
    ),
    ("", "who can commit has left, or the round is chosen"): Guide(
        only=(
            "a coordinator holds an entry more at most",
            "its history was chosen",
            "rounds before were chosen",
            "a chosen entry was decided",
            "a majority elected it",
            "a majority acknowledged it",
            "an acknowledgement promises",
        ),
        claims=("I-LASTING",),
        children=(("p'", "c'"),),
    ),
    ("", "I-AGREE"): Guide(
        only=(
            "what robots act on was chosen",
            "a chosen entry was decided",
            "a majority acknowledged it",
        ),
        claims=("I-ONE-ENTRY", "later epochs hold what may be chosen"),
    ),
}
