"""Decisions where most robots do nothing: those of :func:`.decide`, made of those who do something.

[EVENT-TRANS]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from koord.runtime.motion.arrays import Bools, Ints
from koord.runtime.proposals import Decision, Proposal, decide


def decided(
    round_: int, proposals: Mapping[int, Proposal], order: Sequence[int] | Ints
) -> Decision:
    """Decide a round as :func:`.decide` does; robots without a proposal skip.

    ``order`` names each robot once. It is gone through once for those who propose, and the others
    are counted in by arrays; a round that faults is decided by the whole order.
    """
    ranks: Ints = np.asarray(order, np.int64)
    if not proposals:
        return Decision(round_, (), tuple(ranks.tolist()), ())
    if len(proposals) == len(order):
        return decide(round_, proposals, ranks.tolist())
    proposes: Bools = np.zeros(len(ranks), np.bool_)
    proposes[list(proposals)] = True
    decision = decide(round_, proposals, ranks[proposes[ranks]].tolist())
    if decision.fault is not None:
        return decide(round_, proposals, ranks.tolist())
    skips: Bools = np.ones(len(ranks), np.bool_)
    skips[[taken.robot for taken in decision.ran]] = False
    return replace(decision, skipped=tuple(ranks[skips[ranks]].tolist()))
