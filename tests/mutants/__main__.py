"""``python -m tests.mutants [NAME…]``: a table of mutants and the tests that catch them."""

from __future__ import annotations

import sys

from tests.mutants.catalogue import MUTANTS
from tests.mutants.caught import keep
from tests.mutants.harness import passes, tried


def main(names: list[str]) -> int:
    """Try some mutants, or all; the exit code is the number of those that survive."""
    survivors = 0
    for mutant in MUTANTS:
        if names and not any(name in mutant.name for name in names):
            continue
        outcome = tried(mutant)
        name = outcome.caught_by.rpartition("::")[2]
        fails_anyway = name != outcome.caught_by and not passes(outcome.caught_by)
        survivors += fails_anyway or not outcome.caught_by
        if name != outcome.caught_by and not fails_anyway:
            keep(mutant.name, outcome.caught_by)
        test = f"FAILS WITHOUT IT, TOO: {name}" if fails_anyway else name or "SURVIVED"
        print(f"{mutant.name:52} {outcome.seconds:5.1f} s  {test}", flush=True)
    return survivors


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
