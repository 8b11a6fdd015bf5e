"""Profiles of generated programs whose configurations are few enough to look at all of them."""

from __future__ import annotations

from msgspec.structs import replace

from koord.refinement.generating.palette import Profile

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
