"""What is looked at before anything is armed, for all robots, and who says that it may be."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping

from msgspec import Struct, to_builtins

from koord.runtime.deploy.preflight import Check as Check
from koord.runtime.deploy.preflight import Finding as Finding
from koord.runtime.deploy.status import RobotReport
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.source import whole_file

#: Who looks and does not arm does not wait longer for other robots, in seconds.
PATIENCE_S = 10.0

#: What is bad, of robots that may be armed, may pass in so long: a pose is late at the start, say.
MENDING_S = 5.0

#: And lets the others hear of it for so long after that.
_LINGER_S = 1.0


class Preflight(Struct, frozen=True):
    """What robots have found: of themselves, and of each other. (P-PREFLIGHT)"""

    checks: Mapping[int, tuple[Check, ...]]  #: by pid, of those that are looked at here
    expected: int  #: the number of these

    def of(self, finding: Finding) -> Iterator[tuple[int, Check]]:
        """Yield what was found so, with its robot."""
        for pid, checks in sorted(self.checks.items()):
            for check in checks:
                if check.finding is finding:
                    yield pid, check

    @property
    def is_settled(self) -> bool:
        """True if all robots are there, and nothing is open any more."""
        whole = len(self.checks) == self.expected and all(self.checks.values())
        return whole and not any(self.of(Finding.PENDING))

    @property
    def is_good(self) -> bool:
        """True if nothing is bad, and nothing is open."""
        return self.is_settled and not any(self.of(Finding.BAD))

    def to_dict(self) -> dict[str, object]:
        """What was found as plain data."""
        robots = [
            {"pid": pid, "checks": to_builtins(checks)}
            for pid, checks in sorted(self.checks.items())
        ]
        return {"version": 1, "ok": self.is_good, "robots": robots}

    @property
    def hindrances(self) -> tuple[str, ...]:
        """Why nothing is armed, a line each."""
        if missing := self.expected - len([one for one in self.checks.values() if one]):
            return (f"{missing} robots have told nothing",)
        some = (*self.of(Finding.BAD), *self.of(Finding.PENDING))
        return tuple(f"robot {pid}: {one.name}: {one.text}" for pid, one in some)


#: Asked a few times a second, with what is found by then: True arms, False does not, None waits.
Approval = Callable[[Preflight], bool | None]


def good_enough(preflight: Preflight) -> bool | None:
    """Say yes as soon as all is known: for who has nobody to ask. What is bad is not armed."""
    return True if preflight.is_settled else None


class Looking:
    """The time before a run, in which people look at what robots have found.

    Who says yes to what is bad is refused, unless it is good within some seconds.
    """

    def __init__(self, robots: int, approve: Approval, *, only_looks: bool) -> None:
        self.found = Preflight({}, robots)
        self.is_over = False  #: nothing will be armed, or the run begins
        self.is_approved = False
        self._approve, self._only_looks = approve, only_looks
        self._begun_at = time.monotonic()
        self._settled_at: float | None = None
        self._bad_at: float | None = None  #: since when there is a yes for what is bad

    def hear(self, statuses: Mapping[int, RobotReport]) -> bool | None:
        """Take reports in, and ask: True begins the run, False ends it, None waits."""
        if self.is_over:
            return None
        checks = {pid: status.checks for pid, status in statuses.items() if status.checks}
        self.found = Preflight(checks, self.found.expected)
        if self._only_looks:
            self.is_over = self._has_looked()
            return False if self.is_over else None
        answer = self._approve(self.found)
        if answer is None or (answer and not self.found.is_good and self._may_pass()):
            return None
        self.is_over, self.is_approved = True, answer and self.found.is_good
        return self.is_approved

    def _may_pass(self) -> bool:
        """Return whether what is bad may be good soon."""
        now = time.monotonic()
        if self._bad_at is None:
            self._bad_at = now
        return now - self._bad_at < MENDING_S

    def _has_looked(self) -> bool:
        now = time.monotonic()
        if self.found.is_settled:
            if self._settled_at is None:
                self._settled_at = now
            return now - self._settled_at >= _LINGER_S
        self._settled_at = None
        return now - self._begun_at >= PATIENCE_S

    def refusals(self, name: str) -> tuple[Diagnostic, ...]:
        """Why nothing was armed, as diagnostics."""
        return refusals(self.found, name)


def refusals(found: Preflight, name: str) -> tuple[Diagnostic, ...]:
    """Why nothing was armed, as diagnostics, of what was found and who was asked."""
    place = whole_file(name)
    stories = found.hindrances or ("nobody has said yes",)
    hint = "mend this, or look again with `preflight=`"
    return tuple(
        Diagnostic("K939", Severity.ERROR, place, f"not armed: {story}", hint) for story in stories
    )
