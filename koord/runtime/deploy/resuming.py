"""The beginning of a robot's part in a run, and its return, with a journal. (R-RESUME) (R-START)"""

from __future__ import annotations

from koord.runtime.deploy.journal import Entered, Journal, Recollection, Start
from koord.runtime.deploy.member import Member
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import State, recovered


def enter(member: Member, journal: Journal | None, entered: Entered, start: int) -> None:
    """Note that a robot has entered a run, before it says anything there. Raises OSError."""
    if journal is not None:
        journal.begin(entered, Start(start))
        member.keep(journal, entered, Start(start))


def come_back(
    setup: Setup, member: Member, journal: Journal, kept: Recollection
) -> tuple[State, int]:
    """Be where the journal says; return the state of the protocol, and the number of the start.

    Raises DamagedError, OSError.
    """
    start = kept.starts + 1
    journal.add(Start(start))
    member.recall(kept)
    member.keep(journal, kept.entered, Start(start))
    return recovered(setup, member.robot.pid, kept.durable(setup), start), start
