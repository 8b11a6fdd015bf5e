"""The suite as tests of pytest, for a class of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

from koord.testing.conformance.bench import Bench, Check, Clock
from koord.testing.conformance.findings import Finding, Verdict
from koord.testing.conformance.peers import OtherSide
from koord.testing.conformance.running import CHECKS, bench_of, end, made
from koord.testing.conformance.subjects import Subject


class ConformanceSuite:
    """Tests of a driver: a class of one's own says which, and has a test for each check.

    All tests of a class have one vehicle in common, in the order of the checks.
    """

    #: Checks that are not made, with the reason.
    LEFT_OUT: ClassVar[dict[str, str]] = {}

    _benches: ClassVar[dict[type, Bench]] = {}

    def subject(self) -> Subject:
        """The driver that is tested."""
        raise NotImplementedError

    def peer(self) -> OtherSide | None:
        """The other side of its wire; None: nobody starts and ends it."""
        return None

    def clock(self) -> Clock | None:
        """The time; None: that of the subject."""
        return None

    @classmethod
    def teardown_class(cls) -> None:
        bench = ConformanceSuite._benches.pop(cls, None)
        if bench is not None:
            end(bench)

    def _bench(self) -> Bench:
        benches = ConformanceSuite._benches
        if type(self) not in benches:
            benches[type(self)] = bench_of(self.subject(), self.peer(), self.clock())
        return benches[type(self)]

    def _check(self, check: Check) -> None:
        import pytest

        if check.name in self.LEFT_OUT:
            pytest.skip(self.LEFT_OUT[check.name])
        found = made(check, self._bench())
        if found.verdict is Verdict.SKIPPED:
            pytest.skip(f"{found.why}: {found.cure}" if found.cure else found.why)
        assert found.verdict is Verdict.PASSED, "\n".join(_lines(found))


def _lines(found: Finding) -> Iterator[str]:
    for one in found.measures:
        sign = "" if one.ok else "FAILED: "
        yield f"{sign}{one.seen}" + (f" ({one.limit})" if one.limit else "")


def _test(check: Check) -> Callable[[Any], None]:
    def test(self: ConformanceSuite) -> None:
        self._check(check)

    test.__doc__ = check.about
    return test


for _one in CHECKS:
    setattr(ConformanceSuite, f"test_{_one.name.replace('-', '_')}", _test(_one))
