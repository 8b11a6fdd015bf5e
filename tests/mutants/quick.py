"""Mistakes that are tried in every run of the tests, each by the test known to notice it.

The others are left to `make slow`: each takes a process of its own, and a second or two.
"""

from __future__ import annotations

QUICK = (
    # the rules
    "reads are from the store and not from the snapshot",
    "a lock is never taken",
    "a stopped robot runs events",
    "stop only asks",
    "short circuits evaluate everything",
    "faults in guards are ignored",
    "what is unset counts as set",
    "a break leaves two loops",
    "a queue gives its last",
    "a model reads the values after the turn",
    "writes of parts do not reach the store",
    "lost updates ignore the keys of a map",
    # the verifier
    "two robots may enter one lock class",
    "stopped robots may run in the formula",
    "the first writer wins",
    "assumptions are dropped",
    "a faulted configuration has successors",
    "induction assumes what it is to prove",
    "induction skips the middle of the round",
    "the axiom of a summary is dropped",
    "what is written in atomic blocks is never written",
    "all opaque values are of one type",
    "the witness drops the order",
)
