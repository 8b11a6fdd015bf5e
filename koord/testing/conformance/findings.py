"""What checks find: what was seen, the limits, and a verdict."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct


class Verdict(Enum):
    """What came of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


class Measure(Struct, frozen=True):
    """Something that was seen, and what it had to be."""

    seen: str
    limit: str = ""
    ok: bool = True


class Finding(Struct, frozen=True):
    """What a check of a driver found. ``why`` it was skipped, and a ``cure`` that would help."""

    check: str
    verdict: Verdict
    measures: tuple[Measure, ...] = ()
    why: str = ""
    cure: str = ""
    took_s: float = 0.0


class Skipped(Exception):  # noqa: N818 - it is no error
    """Raised by a check that cannot be made, with what would make it possible."""

    def __init__(self, why: str, cure: str = "") -> None:
        super().__init__(why)
        self.why, self.cure = why, cure


class Failed(Exception):  # noqa: N818 - it is what was looked for
    """Raised by a check that has found what must not be."""

    def __init__(self, seen: str, limit: str = "") -> None:
        super().__init__(seen)
        self.measure = Measure(seen, limit, ok=False)


class Measures:
    """What a check has measured so far."""

    def __init__(self) -> None:
        self.taken: list[Measure] = []

    def expect(self, ok: bool, seen: str, limit: str = "") -> None:
        """Note what was seen. Raises Failed if it must not be."""
        if not ok:
            raise Failed(seen, limit)
        self.taken.append(Measure(seen, limit))

    def at_most(self, value: float, most: float, what: str, unit: str = "m") -> None:
        """Note a number that must not be greater. Raises Failed if it is, or is none."""
        self.expect(value <= most, f"{what} {value:.2f} {unit}", f"at most {most:.2f} {unit}")

    def at_least(self, value: float, least: float, what: str, unit: str = "m") -> None:
        """Note a number that must not be smaller. Raises Failed if it is, or is none."""
        self.expect(value >= least, f"{what} {value:.2f} {unit}", f"at least {least:.2f} {unit}")
