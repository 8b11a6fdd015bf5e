"""The words of a context that a search for fair cycles has, beside those of a search."""

from __future__ import annotations

from koord.kernels.context import CONTEXT_WORDS

#: ``EDGE_DONE`` edges are of states that are looked at whole; the others, up to ``EDGE_COUNT``, of
#: the current one. ``FIRSTS`` has the number of the first edge of each state, ``CHAIN`` the edge
#: before each of the current state's that leads to the same state, ``MARKS`` the last one to each.
(
    EDGE_TARGETS,
    EDGE_LABELS,
    EDGE_COUNT,
    EDGE_DONE,
    EDGE_ROOM,
    FIRSTS,
    NODE_LABELS,
    MARKS,
    CHAIN,
    CHAIN_ROOM,
    LABEL,
) = range(CONTEXT_WORDS, CONTEXT_WORDS + 11)
FAIR_CONTEXT_WORDS = CONTEXT_WORDS + 11
