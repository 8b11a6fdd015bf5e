"""How large generated programs are, and how much in them is left to chance."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace


class Profile(Struct, frozen=True):
    """Sizes are inclusive ranges; rates are probabilities.

    ``finite`` programs have finitely many reachable configurations: integers stay in a small range,
    lists do not grow for ever, and whatever is left open has finitely many answers.
    """

    finite: bool
    robots: tuple[int, int]
    agents: tuple[int, int]
    shared: tuple[int, int]
    locals: tuple[int, int]
    modules: tuple[int, int]
    functions: tuple[int, int]
    externals: tuple[int, int]
    events: tuple[int, int]
    statements: tuple[int, int]
    depth: int  #: of expressions
    nesting: int  #: of statements
    faulty: float  #: indices, divisors and keys that may be wrong
    unset: float  #: variables without an initial value
    urgent: float
    arbitrary: float  #: variables that start arbitrary
    calculates: bool = True  #: if not, integers are robots: stored, compared, used as indices


GENERAL = Profile(
    finite=False,
    robots=(1, 3),
    agents=(1, 2),
    shared=(1, 3),
    locals=(1, 3),
    modules=(0, 2),
    functions=(0, 2),
    externals=(0, 2),
    events=(1, 3),
    statements=(1, 4),
    depth=3,
    nesting=2,
    faulty=0.12,
    unset=0.08,
    urgent=0.2,
    arbitrary=0.1,
)

#: As ``GENERAL``, with little that goes wrong: runs come to their last round.
CALM = replace(GENERAL, faulty=0.01, unset=0.01)

#: As ``GENERAL``, with longer bodies in which more goes wrong, or nearly.
WILD = replace(GENERAL, statements=(2, 5), faulty=0.3, unset=0.1, urgent=0.4)

FINITE = Profile(
    finite=True,
    robots=(2, 3),
    agents=(1, 2),
    shared=(1, 2),
    locals=(1, 2),
    modules=(0, 1),
    functions=(0, 1),
    externals=(0, 1),
    events=(1, 2),
    statements=(1, 3),
    depth=2,
    nesting=2,
    faulty=0.02,
    unset=0.02,
    urgent=0.15,
    arbitrary=0.1,
)

#: As ``FINITE``, of programs in which most robots may change places.
SYMMETRIC = replace(FINITE, robots=(3, 3), agents=(1, 1), shared=(2, 3), calculates=False)
