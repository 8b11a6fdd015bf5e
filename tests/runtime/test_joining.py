"""A robot's end of the handshake, in virtual time: whom it lets in late, and what it notices."""

from __future__ import annotations

from msgspec.structs import replace

from koord.runtime.deploy.joining import Ending, Joining
from koord.runtime.protocol.handshake import NO_RUN, EnterLate, Known, Party, TurnedAway
from koord.runtime.protocol.messages import Ask
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import Drop, fleet_key
from tests.runtime.hub import Hub

RUN = bytes([7]) * 16
KEY = fleet_key(b"a key of the tests", "koord")


class Place:
    """Two robots in a run, and a third that comes back; what the two have heard of it."""

    def __init__(self) -> None:
        self.now = 0.0
        self.hub = Hub(3)
        self.heard_at: float | None = 0.0  #: when robot 2 was heard in the run
        self.there = [self.end(pid, RUN) for pid in (0, 1)]

    def end(self, pid: int, run: bytes = NO_RUN, start: int = 0, key: bytes = KEY) -> Joining:
        party = Party(pid, 3, 0, bytes([pid, start]) * 8, (("program", "p"),), key)
        return Joining(party, self.hub.transport(pid), lambda: self.now, run)

    def known(self, robot: int) -> tuple[Known, float | None]:
        return Known(0, 1, is_heard=False), self.heard_at if robot == 2 else self.now

    def turn(self, *back: Joining) -> None:
        """A tenth of a second."""
        self.now += 0.1
        for one in back:
            one.turn(0.0)
        for pid, one in enumerate(self.there):
            for datagram in self.hub.transport(pid).receive(0.0):
                one.answer(datagram, self.known)
        for one in back:
            one.turn(0.0)

    def until(self, seconds: float, *back: Joining) -> None:
        end = self.now + seconds
        while self.now < end:
            self.turn(*back)


def endings(one: Joining) -> list[Ending]:
    return [] if one.ending is None else [one.ending]


def test_a_robot_that_is_back_at_once_is_let_in_when_it_is_sure_to_be_alone() -> None:
    """(R-LATE) (R-NAME): its own datagrams of before the crash make no twin of it."""
    place = Place()
    back = place.end(2, start=1)
    place.until(0.9, back)
    assert endings(back) == []
    assert place.there[0].notes == ()
    place.until(1.0, back)
    assert endings(back) == [EnterLate(RUN, 0, 1)]
    assert place.there[0].notes == ()


def test_a_second_process_is_named_while_the_first_is_heard() -> None:
    """(R-NAME): from its first moments on."""
    place = Place()
    twin = place.end(2, start=1)
    for _ in range(20):
        place.turn(twin)
        place.heard_at = place.now
    assert twin.ending is None
    assert twin.notes == ("two processes say that they are robot 2",)
    assert place.there[0].notes == ("two processes say that they are robot 2",)


def test_who_comes_back_at_once_with_another_program_is_named_by_all() -> None:
    """(R-NAME): by those who heard it in the run a moment ago, too."""
    place = Place()
    back = place.end(2, start=1)
    back.party = replace(back.party, fingerprint=(("program", "q"),))
    place.turn(back)
    assert back.ending == TurnedAway(0, (("program", "p"),))
    for one in place.there:
        assert one.notes == ("robot 2 runs something else (program: p here, q there)",)


def test_a_robot_that_was_let_in_is_no_twin_of_itself() -> None:
    """A Join of it may come after what it says in the run."""
    place = Place()
    place.heard_at = None
    back = place.end(2, start=1)
    place.until(1.0, back)
    assert isinstance(back.ending, EnterLate)
    place.heard_at = place.now
    place.until(1.0, place.end(2, start=1))
    assert place.there[0].notes == ()


def test_a_robot_with_its_journal_is_answered_at_once() -> None:
    """(R-RUNNING) (R-START)"""
    place = Place()
    back = place.end(2, RUN)
    higher: list[int] = []
    back.higher = higher.append
    place.turn(back)
    assert higher == [1, 1]


def test_old_joins_of_a_robot_make_no_flood_of_answers() -> None:
    """(I-FRESH)"""
    place = Place()
    place.heard_at = None
    place.end(2, start=1).turn(0.0)
    (old,) = place.hub.transport(0).receive(0.0)
    sent = place.hub.sent
    for _ in range(500):
        place.there[0].answer(old, place.known)
    assert place.hub.sent - sent == 1
    assert place.there[0].drops[Drop.EARLIER] == 499


def test_another_key_is_named_after_several_datagrams() -> None:
    """(R-NAME)"""
    place = Place()
    place.until(2.0, place.end(2, key=fleet_key(b"another", "koord")))
    assert place.there[0].notes == ("robot 2 has another key, or somebody uses its name",)
    place.until(4.0)
    assert not place.there[0].notes


def test_what_is_of_runs_is_handed_on() -> None:
    place = Place()
    datagrams = DatagramWriter(Channel(KEY, 3, 1)).datagrams(0, 0, Ask(3))
    place.hub.inboxes[2].extend(datagrams)
    assert place.end(2).turn(0.0) == datagrams


def test_robots_in_a_run_show_a_new_leader_that_they_have_heard_it() -> None:
    """(R-JOIN) (R-NAME): so that it names those who go on with a journal that it lacks."""
    place = Place()
    place.heard_at = None
    leader, back = place.end(0, start=1), place.end(2, RUN)
    leader.turn(0.0)
    for datagram in place.hub.transport(2).receive(0.0):
        back.answer(datagram, place.known)
    place.now += 1.0
    back.wake()
    leader.turn(0.0)
    assert any("robot 2 is in a run" in note for note in leader.notes)


def test_notes_are_of_one_fleet() -> None:
    """A robot that is no part of this fleet is not named."""
    place = Place()
    party = replace(place.end(2).party, pid=9, robots=12)
    other = Joining(party, place.hub.transport(2), lambda: place.now)
    place.until(1.0, other)
    assert place.there[0].notes == ()
