"""Seeded mistakes in deployed robots: all agree on what was decided, and one makes it wrong."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

DEPLOY = "tests/runtime/test_deploy.py"
ELECTIONS = "tests/runtime/test_elections.py"
JUDGED = "tests/refinement/test_deployed.py"

#: What is caught by judging runs, mostly.
DEPLOYED = (
    Mutant(
        "a proposal from the journal is let through on an empty store",
        "runtime/deploy/member.py",
        "has no shared variables.\n            self.robot.refresh(changed)",
        "has no shared variables.\n            vars(self.robot).update(changed)",
        (JUDGED,),
    ),
    Mutant(
        "what ran rounds ago ran in this one",
        "runtime/deploy/member.py",
        "if mine.round < round_ - 1:",
        "if mine.round < 0:",
        (JUDGED,),
    ),
    Mutant(
        "rounds that were missed have no environment's turn",
        "runtime/deploy/member.py",
        "self._turns += missed",
        "self._turns += min(missed, 0)",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "an event that was let through is thrown away",
        "runtime/deploy/member.py",
        "if kept is None or self.mute:",
        "if kept is None or self.mute or self.round % 5 == 4:",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "who asked to stop with the others has not",
        "runtime/deploy/member.py",
        "            self.statuses = [Status.STOPPED] * len(self.statuses)",
        "            self.statuses = list(self.statuses)",
        (JUDGED, DEPLOY),
    ),
    Mutant(
        "a robot that is back has not written down what it senses",
        "runtime/deploy/member.py",
        "self.round, self._turns, self._proposal = page.round, page.turns, page.proposal",
        "self.round, self._turns, self._proposal = page.round, 1, page.proposal",
        (JUDGED,),
    ),
    Mutant(
        "robots whose models fault need not be heard",
        "runtime/robot.py",
        "return bool(cls._urgent) or cls.MODEL_MAY_FAULT",
        "return bool(cls._urgent)",
        (JUDGED,),
    ),
    Mutant(
        "no model may fault",
        "runtime/compile/program.py",
        '"\\n".join(text))) > sure',
        '"\\n".join(text))) < 0',
        (JUDGED,),
    ),
    Mutant(
        "a model faults in the round after",
        "runtime/deciding.py",
        "    if stumbled is not None:\n",
        "    if stumbled is not None and round_ < 0:\n",
        (JUDGED,),
    ),
    Mutant(
        "nobody tells that the run is over",
        "runtime/protocol/machine.py",
        "            state.ended,\n",
        "            False,\n",
        (JUDGED,),
    ),
    Mutant(
        "nobody teaches when the run is over",
        "runtime/protocol/coordinating.py",
        "isinstance(desk, Coordinator)) or state.ended:",
        "isinstance(desk, Coordinator)):",
        (ELECTIONS,),
    ),
    Mutant(
        "who holds a round is taught from the next one on",
        "runtime/protocol/entries.py",
        "return self.round + (self.epoch == COMMITTED)",
        "return self.round + 1",
        (JUDGED, ELECTIONS),
    ),
    Mutant(
        "a digest says nothing of the store",
        "runtime/deploy/member.py",
        "if decision.digest and decision.digest != self.store.digest():",
        "if decision.digest and decision.digest == b'':",
        (DEPLOY,),
    ),
    Mutant(
        "a robot that holds goes on",
        "runtime/deploy/member.py",
        "self.host.holding = reason is not None",
        "self.host.holding = reason is None",
        (DEPLOY,),
    ),
)
