"""The CPU time of starting koord, best and median of several runs: a table, and JSON with --json.

The target is ``koord --help`` in at most 0.15 s of CPU time.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys

RUNS = 15

PROGRAMS = {
    "python -c pass": ["-c", "pass"],
    "import koord": ["-c", "import koord"],
    "koord --help": ["-m", "koord", "--help"],
    "koord verify --help": ["-m", "koord", "verify", "--help"],
}


def cpu_s(arguments: list[str]) -> float:
    """User and system time of one run of the interpreter."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    as_json = parser.parse_args().json
    rows = []
    for name, arguments in PROGRAMS.items():
        times = [cpu_s(arguments) for _ in range(RUNS)]
        rows.append({"what": name, "best_s": min(times), "median_s": statistics.median(times)})
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    print(f"{'CPU time of':<22} {'best s':>8} {'median s':>9}")
    for row in rows:
        print(f"{row['what']:<22} {row['best_s']:>8.3f} {row['median_s']:>9.3f}")


if __name__ == "__main__":
    main()
