"""Write what is frozen anew: all scenarios, or those that are named. Shows what has changed.

`python -m tests.golden [NAME…]`; a name may be the beginning of several, such as `task/`.
"""

from __future__ import annotations

import sys
import time

from tests.golden.kept import difference, is_kept, keep, kept
from tests.golden.scenarios import scenarios
from tests.golden.transcript import plain_surroundings, transcript


def main(names: list[str]) -> None:
    """Play the scenarios, and keep what they print and write."""
    plain_surroundings()
    for scenario in scenarios():
        if names and not scenario.name.startswith(tuple(names)):
            continue
        started = time.perf_counter()
        before = kept(scenario) if is_kept(scenario) else ""
        now = transcript(scenario)
        keep(scenario, now)
        lines = list(difference(before, now))
        seconds = time.perf_counter() - started
        print(f"{scenario.name}: {seconds:.1f} s, {len(now.splitlines())} lines", flush=True)
        if before:
            print("\n".join(lines[:40]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
