"""The test that noticed each mistake when it was last tried: it is asked first.

`python -m tests.mutants` keeps it. A test that is renamed leaves no gap: where the one that is
known notices nothing, all tests of the mutant are asked.
"""

from __future__ import annotations

import json
from pathlib import Path

_FILE = Path(__file__).with_name("caught.json")


def caught() -> dict[str, str]:
    """Node ids of tests by the names of mutants."""
    found: dict[str, str] = json.loads(_FILE.read_text("utf-8"))
    return found


def keep(mutant: str, test: str) -> None:
    """Remember what noticed a mutant."""
    known = caught() | {mutant: test}
    text = json.dumps(known, indent=1, sort_keys=True, ensure_ascii=False)
    _FILE.write_text(f"{text}\n", "utf-8")
