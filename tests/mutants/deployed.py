"""Seeded mistakes in deployed robots: all agree on what was decided, and one makes it wrong."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DEPLOY = "tests/runtime/test_deploy.py"
ELECTIONS = "tests/runtime/test_elections.py"
SHARED = "tests/runtime/test_shared.py"
SUPERVISED = "tests/runtime/test_supervision.py"
STRUCK = "tests/api/test_supervised.py"
JUDGED = "tests/refinement/test_deployed.py"

#: What is caught by judging runs, mostly.
DEPLOYED = (
    Mutant(
        "what a robot tells all comes back to it in a shared process",
        "runtime.transports.udp.Mailbox.take",
        "source != self._own",
        "True",
        (SHARED,),
    ),
    Mutant(
        "who shares a process does not see that its name is used",
        "runtime.wire.codec.DatagramReader.read",
        "found is not None and found[0].sender != channel.pid",
        "found is not None",
        (SHARED,),
    ),
    Mutant(
        "robots that share a process have their turn by time alone",
        "runtime.deploy.together.run_together",
        "not one.end.has_mail",
        "True",
        (SHARED,),
    ),
    Mutant(
        "who crashes ends those that share its process",
        "runtime.deploy.local.LocalProcesses._is_shared",
        "other is process and not end.closed",
        "False",
        (SHARED,),
    ),
    Mutant(
        "who has crashed keeps its ports in a shared process",
        "runtime.deploy.local._going",
        "transport.close()",
        "pass",
        (SHARED,),
    ),
    Mutant(
        "where one datagram came there is never more than one",
        "runtime.transports.udp.Pace.takes_all",
        "self._left -= 1",
        "pass",
        ("tests/runtime/test_transports.py",),
    ),
    Mutant(
        "what has something to say of itself is never asked",
        "runtime.deploy.running._is_timeless",
        "made.tick is Untimed.tick and made.beacon is Untimed.beacon",
        "made.tick is Untimed.tick",
        (SHARED,),
    ),
    Mutant(
        "what the kernel dropped is forgotten when a robot ends",
        "runtime.transports.udp.Udp.close",
        "self._dropped, self._is_closed = self.dropped, True",
        "self._dropped, self._is_closed = 0, True",
        ("tests/runtime/test_transports.py",),
    ),
    Mutant(
        "pieces of a handshake that never got complete are dropped without a word",
        "runtime.wire.codec._whole",
        "assembly.dropped != before",
        "assembly.dropped < before",
        ("tests/runtime/test_wire.py",),
    ),
    Mutant(
        "a proposal from the journal is let through on an empty store",
        "runtime.deploy.member.Member.install",
        "self.robot.refresh",
        "vars(self.robot).update",
        (JUDGED,),
    ),
    Mutant(
        "what ran rounds ago ran in this one",
        "runtime.deploy.member.Member.install",
        "round_ - 1",
        "0",
        (JUDGED,),
    ),
    Mutant(
        "rounds that were missed have no environment's turn",
        "runtime.deploy.member.Member.install",
        "self._turns += missed",
        "self._turns += min(missed, 0)",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "an event that was let through is thrown away",
        "runtime.deploy.member.Member._act",
        "kept is None or self.mute",
        "kept is None or self.mute or self.round % 5 == 4",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "who asked to stop with the others has not",
        "runtime.deploy.member.Member._note_statuses",
        "[Status.STOPPED] * len(self.statuses)",
        "list(self.statuses)",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "a robot that is back has not written down what it senses",
        "runtime.deploy.member.Member._take_up",
        "page.turns",
        "1",
        (JUDGED,),
    ),
    Mutant(
        "robots whose models fault need not be heard",
        "runtime.robot.Robot.owes",
        "bool(cls._urgent) or cls.MODEL_MAY_FAULT",
        "bool(cls._urgent)",
        (JUDGED,),
    ),
    Mutant(
        "no model may fault",
        "runtime.compile.program.ProgramModule.may_fault",
        'len(re.findall(r\'"[^"\\n]*\\d+:\\d+"\', "\\n".join(text))) > sure',
        'len(re.findall(r\'"[^"\\n]*\\d+:\\d+"\', "\\n".join(text))) < 0',
        (JUDGED,),
    ),
    Mutant(
        "a model faults in the round after",
        "runtime.proposals.decide",
        "stumbled is not None",
        "stumbled is not None and round_ < 0",
        (JUDGED,),
    ),
    Mutant(
        "nobody tells that the run is over",
        "runtime.protocol.machine._show",
        "state.ended",
        "False",
        (JUDGED,),
    ),
    Mutant(
        "nobody teaches when the run is over",
        "runtime.protocol.coordinating.on_hello",
        "(message.empty and isinstance(desk, Coordinator)) or state.ended",
        "message.empty and isinstance(desk, Coordinator)",
        (ELECTIONS,),
    ),
    Mutant(
        "who holds a round is taught from the next one on",
        "runtime.protocol.messages.Position.open",
        "self.epoch == COMMITTED",
        "1",
        (JUDGED, ELECTIONS),
    ),
    Mutant(
        "a digest says nothing of the store",
        "runtime.deploy.member.Member._apply",
        "decision.digest != self.store.digest()",
        "decision.digest == b''",
        (DEPLOY,),
    ),
    Mutant(
        "a robot that holds goes on",
        "runtime.deploy.member.Member.hold",
        "reason is not None",
        "reason is None",
        (DEPLOY,),
    ),
    Mutant(
        "a robot that is asked to end by a signal does so at once",
        "runtime.deploy.local._Asked._on_signal",
        "self._by is not None",
        "self._by is None",
        (STRUCK,),
    ),
    Mutant(
        "who dies at once is restarted for ever",
        "runtime.deploy.supervision.Supervisor.ended",
        "self._deaths[pid] + 1",
        "1",
        (SUPERVISED,),
    ),
    Mutant(
        "who lives for long is given up one day",
        "runtime.deploy.supervision.Supervisor.ended",
        "now - self._started[pid] < AT_ONCE_S",
        "True",
        (SUPERVISED,),
    ),
    Mutant(
        "robots are restarted that nobody could tell anything",
        "runtime.deploy.supervision.Supervisor._state_after",
        "self.is_stopping or any(map(_is_done, self.statuses.values()))",
        "self.is_stopping",
        (SUPERVISED,),
    ),
    Mutant(
        "half of the robots are a majority",
        "runtime.deploy.supervision.Supervisor._hindrance",
        "robots // 2 + 1",
        "(robots + 1) // 2",
        (SUPERVISED,),
    ),
    Mutant(
        "robots that may not skip are not missed",
        "runtime.deploy.supervision.Supervisor._hindrance",
        "pid in self._owing",
        "pid not in self.processes",
        (SUPERVISED,),
    ),
    Mutant(
        "a robot that is back counts from nothing",
        "runtime.deploy.supervision.Supervisor.heard",
        "before is None",
        "before is not status",
        (SUPERVISED,),
    ),
)
