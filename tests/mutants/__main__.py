"""``python -m tests.mutants [NAME…]``: a table of mutants and the tests that catch them."""

from __future__ import annotations

import sys

from tests.mutants.catalogue import MUTANTS
from tests.mutants.caught import keep
from tests.mutants.harness import tried


def main(names: list[str]) -> int:
    """Try some mutants, or all; the exit code is the number of those that survive."""
    survivors = 0
    for mutant in MUTANTS:
        if names and not any(name in mutant.name for name in names):
            continue
        outcome = tried(mutant)
        survivors += not outcome.caught_by
        if "::" in outcome.caught_by:
            keep(mutant.name, outcome.caught_by)
        test = outcome.caught_by.rpartition("::")[2] or outcome.caught_by or "SURVIVED"
        print(f"{mutant.name:52} {outcome.seconds:5.1f} s  {test}", flush=True)
    return survivors


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
