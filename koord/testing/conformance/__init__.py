"""What every driver passes, against the other side of its wire.

A lab runs it on its own driver with ``koord conform``, or as a test of its own::

    from koord.testing.conformance import ConformanceSuite, Subject

    class TestMyCar(ConformanceSuite):
        def subject(self) -> Subject:
            return Subject("mylab:Car", b'{"port": 7000}', "DIFF", arms=True)
"""

from __future__ import annotations

from koord.testing.conformance.bench import Check as Check
from koord.testing.conformance.findings import Finding as Finding
from koord.testing.conformance.findings import Measure as Measure
from koord.testing.conformance.findings import Verdict as Verdict
from koord.testing.conformance.peers import KNOWN as KNOWN
from koord.testing.conformance.peers import CommandPeer as CommandPeer
from koord.testing.conformance.peers import OtherSide as OtherSide
from koord.testing.conformance.peers import Truth as Truth
from koord.testing.conformance.running import CHECKS as CHECKS
from koord.testing.conformance.running import conform as conform
from koord.testing.conformance.subjects import Subject as Subject
from koord.testing.conformance.suite import ConformanceSuite as ConformanceSuite
