"""Seeded mistakes in the round-commit protocol and in the wire."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ROUNDS = "tests/runtime/test_rounds.py"
ELECTIONS = "tests/runtime/test_elections.py"
EXPLORATION = "tests/runtime/test_exploration.py"
CHAOS = "tests/runtime/test_chaos.py"
WIRE = "tests/runtime/test_wire.py"

#: What keeps robots in agreement, and what keeps them going.
PROTOCOL = (
    Mutant(
        "two robots get one lock class of a round",
        "runtime/deciding.py",
        "taken.update(attempt.locks)",
        "taken.clear()",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "who loses a lock does not try its other events",
        "runtime/deciding.py",
        "for attempt in proposal.attempts:",
        "for attempt in proposal.attempts[:1]:",
        (ROUNDS,),
    ),
    Mutant(
        "the order never rotates",
        "runtime/deciding.py",
        "first = round_ % robots if robots else 0",
        "first = 0 * round_",
        (ROUNDS,),
    ),
    Mutant(
        "one robot is a majority",
        "runtime/protocol/coordinating.py",
        "if len(holders) < turn.setup.majority:",
        "if not holders:",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "acknowledgements of another epoch count",
        "runtime/protocol/coordinating.py",
        "if message.epoch == state.promised and message.digest == held.digest:",
        "if message.digest == held.digest:",
        (ELECTIONS,),
    ),
    Mutant(
        "acknowledgements of another entry count",
        "runtime/protocol/coordinating.py",
        "if message.epoch == state.promised and message.digest == held.digest:",
        "if message.epoch == state.promised:",
        (ROUNDS, ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "what a robot said before it came back counts",
        "runtime/protocol/state.py",
        "return self.roster[robot] == incarnation",
        "return incarnation >= 0",
        (ELECTIONS,),
    ),
    Mutant(
        "a robot helps to decide on its own return",
        "runtime/protocol/state.py",
        "if admission.robot == robot:",
        "if admission.robot == robot and robot < 0:",
        (ELECTIONS,),
    ),
    Mutant(
        "everyone who is back is admitted at once",
        "runtime/protocol/coordinating.py",
        "for robot, incarnation in desk.guests[:most])",
        "for robot, incarnation in desk.guests[: most + 9])",
        (ELECTIONS,),
    ),
    Mutant(
        "the deadline is for those who owe a proposal too",
        "runtime/protocol/coordinating.py",
        "if missing and (not desk.overdue or owed(turn) & frozenset(missing)):",
        "if missing and not desk.overdue:",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "nobody is waited for",
        "runtime/protocol/coordinating.py",
        "if missing and (not desk.overdue or owed(turn) & frozenset(missing)):",
        "if missing and owed(turn) & frozenset(missing):",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "a robot may propose for another",
        "runtime/protocol/coordinating.py",
        "if proposal.robot != sender:",
        "if proposal.robot < 0:",
        (ROUNDS,),
    ),
    Mutant(
        "the last proposal of a robot counts, and not the first",
        "runtime/protocol/coordinating.py",
        "if desk.proposals[proposal.robot] is None:",
        "if proposal.robot >= 0:",
        (ROUNDS,),
    ),
    Mutant(
        "a new coordinator forgets what was being decided",
        "runtime/protocol/coordinating.py",
        "    if state.tentative is not None:\n        _put_forward(turn, state.tentative.entry)\n"
        "        return\n",
        "    turn.change(tentative=None)\n",
        (ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "robots act on the decision, and not on the commit",
        "runtime/protocol/following.py",
        "    turn.change(tentative=Held(message.epoch, entry, mark))\n    if state.is_voter:",
        "    turn.change(tentative=Held(message.epoch, entry, mark))\n"
        "    commit(turn, Held(message.epoch, entry, mark))\n    if state.is_voter:",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "a commit of another entry is acted on",
        "runtime/protocol/following.py",
        "held is not None and held.digest == message.digest:",
        "held is not None:",
        (ROUNDS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "any later entry commits the one held",
        "runtime/protocol/following.py",
        "if held is not None and held.digest == previous and round_ == held.round + 1:",
        "if held is not None and round_ == held.round + 1:",
        (ELECTIONS, CHAOS),
    ),
    Mutant(
        "decisions of lower epochs are taken",
        "runtime/protocol/following.py",
        "if epoch < state.promised:\n        turn.send(sender, Overruled(state.promised))\n"
        "        return False",
        "if epoch < state.promised:\n        turn.send(sender, Overruled(state.promised))",
        (ELECTIONS,),
    ),
    Mutant(
        "who is not admitted acknowledges",
        "runtime/protocol/following.py",
        "    if state.is_voter:\n        turn.send(sender, Acknowledge(message.epoch, entry.round, "
        "mark))\n    turn.await_answer()",
        "    turn.send(sender, Acknowledge(message.epoch, entry.round, mark))\n"
        "    turn.await_answer()",
        (ELECTIONS,),
    ),
    Mutant(
        "history need not fit",
        "runtime/protocol/following.py",
        "if entry.round != state.round or entry.previous != state.chain:",
        "if entry.round < state.round:",
        (ROUNDS,),
    ),
    Mutant(
        "nobody asks for what it missed a second time",
        "runtime/protocol/following.py",
        "    if state.is_behind:\n        return Ask(state.round)\n",
        "",
        (CHAOS, ELECTIONS),
    ),
    Mutant(
        "a lost acknowledgement stays lost",
        "runtime/protocol/following.py",
        "return Acknowledge(held.epoch, held.round, held.digest, again=True)",
        "return None if held.epoch >= 0 else Ask(0)",
        (ROUNDS,),
    ),
    Mutant(
        "a vote is given to whoever asks",
        "runtime/protocol/electing.py",
        "    if message.position < state.position:\n        teach(turn, sender, "
        "message.position.open)\n        return\n    if not state.is_voter",
        "    if not state.is_voter",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a vote promises nothing",
        "runtime/protocol/electing.py",
        "        turn.promise(epoch)\n        turn.follow_nobody()\n        turn.watch_leader()",
        "        turn.follow_nobody()\n        turn.watch_leader()",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "votes of another epoch count",
        "runtime/protocol/electing.py",
        "if isinstance(state.office, Candidate) and message.epoch == state.promised:",
        "if isinstance(state.office, Candidate):",
        (ELECTIONS,),
    ),
    Mutant(
        "who hears its coordinator supports another",
        "runtime/protocol/electing.py",
        "case Follower(leader=leader) if leader is None or leader == sender:",
        "case Follower(leader=leader) if leader != state.pid:",
        (ELECTIONS,),
    ),
    Mutant(
        "one voice elects",
        "runtime/protocol/electing.py",
        "if len(voters) >= turn.setup.majority:",
        "if voters:",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a coordinator that hears nobody stays",
        "runtime/protocol/coordinating.py",
        "if len(desk.heard | {state.pid}) < turn.setup.majority:",
        "if not desk.heard | {state.pid}:",
        (ELECTIONS,),
    ),
    Mutant(
        "nobody is told that it has a twin",
        "runtime/protocol/committing.py",
        "if state.roster[state.pid] > state.incarnation:",
        "if state.roster[state.pid] < 0:",
        (ELECTIONS,),
    ),
    Mutant(
        "epochs belong to nobody",
        "runtime/protocol/electing.py",
        "if setup.coordinator(epoch) != sender or epoch < state.promised:",
        "if epoch < state.promised:",
        (ELECTIONS,),
    ),
    Mutant(
        "a history has no beginning",
        "runtime/protocol/entries.py",
        "flat = (flat_decision(entry.decision), entry.previous, admitted, entry.late)",
        "flat = (flat_decision(entry.decision), admitted, entry.late)",
        (ROUNDS,),
    ),
    Mutant(
        "what a robot ran last is forgotten",
        "runtime/protocol/committing.py",
        "changed[taken.robot] = Ran(entry.round, taken.event)",
        "changed[taken.robot] = Ran(entry.round - 1, taken.event)",
        (ELECTIONS, CHAOS),
    ),
)

#: What lets a stranger in, or keeps a friend out.
WIRE_MISTAKES = (
    Mutant(
        "nobody looks at the proof",
        "runtime/wire/frames.py",
        "if not compare_digest(proof.digest(), datagram[end:]):",
        "if len(proof.digest()) != len(datagram[end:]):",
        (WIRE,),
    ),
    Mutant(
        "the header is not covered by the proof",
        "runtime/wire/frames.py",
        "        proof.update(datagram[:end])\n        if not",
        "        proof.update(datagram[HEADER_BYTES:end])\n        if not",
        (WIRE,),
    ),
    Mutant(
        "the key is the same for every run",
        "runtime/wire/frames.py",
        "digest = blake2b(run.encode(), key=shared_key",
        "digest = blake2b(b'', key=shared_key",
        (WIRE,),
    ),
    Mutant(
        "replays are let in",
        "runtime/wire/replays.py",
        "if ahead <= -WIDTH or self.seen & bit:",
        "if ahead <= -WIDTH:",
        (WIRE,),
    ),
    Mutant(
        "what is older than the window is let in",
        "runtime/wire/replays.py",
        "if ahead <= -WIDTH or self.seen & bit:",
        "if ahead > -WIDTH and self.seen & bit:",
        (WIRE,),
    ),
    Mutant(
        "a robot is replayed from before its restart",
        "runtime/wire/replays.py",
        "            if incarnation < self.incarnation:\n                return False\n",
        "",
        (WIRE,),
    ),
    Mutant(
        "pieces of two messages are mixed",
        "runtime/wire/pieces.py",
        "key = (frame.sender, frame.incarnation, frame.number - piece, frame.kind, pieces)",
        "key = (frame.sender, frame.incarnation, 0, frame.kind, pieces)",
        (WIRE,),
    ),
    Mutant(
        "unfinished messages pile up",
        "runtime/wire/pieces.py",
        "while self._size > self.most_bytes:",
        "while self._size > self.most_bytes * 1_000_000:",
        (WIRE,),
    ),
    Mutant(
        "datagrams grow with their message",
        "runtime/wire/pieces.py",
        'pieces = [body[at : at + ROOM] for at in range(0, len(body), ROOM)] or [b""]',
        "pieces = [body]",
        (WIRE,),
    ),
    Mutant(
        "robots that do not exist are believed in",
        "runtime/wire/bodies.py",
        "return all(0 <= robot < robots for robot in named)",
        "return all(0 <= robot for robot in named)",
        (WIRE,),
    ),
    Mutant(
        "nonsense with the right key raises",
        "runtime/wire/bodies.py",
        "except (msgspec.MsgspecError, NotPlainError, ValueError, RecursionError):",
        "except NotPlainError:",
        (WIRE,),
    ),
    Mutant(
        "values of other languages are let in",
        "runtime/encoding.py",
        'raise NotPlainError(f"a {type(value).__name__}")',
        "return None",
        (WIRE,),
    ),
    Mutant(
        "great numbers lose their sign",
        "runtime/encoding.py",
        'return int.from_bytes(data, "big", signed=True)',
        'return int.from_bytes(data, "big", signed=False)',
        (WIRE,),
    ),
)
