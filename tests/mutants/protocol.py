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
        "runtime.proposals.decide",
        "taken.update(attempt.locks)",
        "taken.clear()",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "who loses a lock does not try its other events",
        "runtime.proposals._let_through",
        "proposal.attempts",
        "proposal.attempts[:1]",
        (ROUNDS,),
    ),
    Mutant(
        "the order never rotates",
        "runtime.proposals.rotating",
        "round_ % robots if robots else 0",
        "0 * round_",
        (ROUNDS,),
    ),
    Mutant(
        "one robot is a majority",
        "runtime.protocol.coordinating._count",
        "len(holders) < turn.setup.majority",
        "not holders",
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "acknowledgements of another epoch count",
        "runtime.protocol.coordinating.on_acknowledge",
        "message.epoch == state.promised and message.digest == held.digest",
        "message.digest == held.digest",
        (ELECTIONS,),
    ),
    Mutant(
        "acknowledgements of another entry count",
        "runtime.protocol.coordinating.on_acknowledge",
        "message.epoch == state.promised and message.digest == held.digest",
        "message.epoch == state.promised",
        (ROUNDS, ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "what a robot said before it came back counts",
        "runtime.protocol.state.State.counts",
        "self.roster[robot] == incarnation",
        "incarnation >= 0",
        (ELECTIONS,),
    ),
    Mutant(
        "a robot helps to decide on its own return",
        "runtime.protocol.state.State.counts",
        "admission.robot == robot",
        "admission.robot == robot and robot < 0",
        (ELECTIONS,),
    ),
    Mutant(
        "everyone who is back is admitted at once",
        "runtime.protocol.coordinating._admissions",
        "desk.guests[:most]",
        "desk.guests[: most + 9]",
        (ELECTIONS,),
    ),
    Mutant(
        "the deadline is for those who owe a proposal too",
        "runtime.protocol.coordinating.decide_if_ready",
        "not desk.overdue or owed(turn) & frozenset(missing)",
        "not desk.overdue",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "nobody is waited for",
        "runtime.protocol.coordinating.decide_if_ready",
        "not desk.overdue or owed(turn) & frozenset(missing)",
        "owed(turn) & frozenset(missing)",
        (ROUNDS, CHAOS),
    ),
    Mutant(
        "a robot may propose for another",
        "runtime.protocol.coordinating.on_propose",
        "proposal.robot != sender",
        "proposal.robot < 0",
        (ROUNDS,),
    ),
    Mutant(
        "the last proposal of a robot counts, and not the first",
        "runtime.protocol.coordinating.gather",
        "desk.proposals[proposal.robot] is None",
        "proposal.robot >= 0",
        (ROUNDS,),
    ),
    Mutant(
        "a new coordinator forgets what was being decided",
        "runtime.protocol.coordinating.take_office",
        (
            "if state.tentative is not None:\n"
            "    _put_forward(turn, state.tentative.entry)\n"
            "    return"
        ),
        "turn.change(tentative=None)",
        (ELECTIONS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "robots act on the decision, and not on the commit",
        "runtime.protocol.following.on_decide",
        "turn.change(tentative=Held(message.epoch, entry, mark))",
        (
            "turn.change(tentative=Held(message.epoch, entry, mark))\n"
            "commit(turn, Held(message.epoch, entry, mark))"
        ),
        (ROUNDS, EXPLORATION),
    ),
    Mutant(
        "a commit of another entry is acted on",
        "runtime.protocol.following.on_committed",
        "message.round == state.round and held is not None and held.digest == message.digest",
        "message.round == state.round and held is not None",
        (ROUNDS, EXPLORATION, CHAOS),
    ),
    Mutant(
        "any later entry commits the one held",
        "runtime.protocol.following._commit_if_chained",
        "held is not None and held.digest == previous and round_ == held.round + 1",
        "held is not None and round_ == held.round + 1",
        (ELECTIONS, CHAOS),
    ),
    Mutant(
        "decisions of lower epochs are taken",
        "runtime.protocol.following.follow",
        "turn.send(sender, Overruled(state.promised))\nreturn False",
        "turn.send(sender, Overruled(state.promised))",
        (ELECTIONS,),
    ),
    Mutant(
        "who is not admitted acknowledges",
        "runtime.protocol.following.on_decide",
        (
            "if state.is_voter:\n"
            "    turn.send(sender, Acknowledge(message.epoch, entry.round, mark))"
        ),
        "turn.send(sender, Acknowledge(message.epoch, entry.round, mark))",
        (ELECTIONS,),
    ),
    Mutant(
        "history need not fit",
        "runtime.protocol.following.on_history",
        "entry.round != state.round or entry.previous != state.chain",
        "entry.round < state.round",
        (ROUNDS,),
    ),
    Mutant(
        "nobody asks for what it missed a second time",
        "runtime.protocol.following._unanswered",
        "if state.is_behind:\n    return Ask(state.round)",
        "pass",
        (CHAOS, ELECTIONS),
    ),
    Mutant(
        "a lost acknowledgement stays lost",
        "runtime.protocol.following._unanswered",
        "Acknowledge(held.epoch, held.round, held.digest, again=True)",
        "None if held.epoch >= 0 else Ask(0)",
        (ROUNDS,),
    ),
    Mutant(
        "a vote is given to whoever asks",
        "runtime.protocol.electing.on_candidacy",
        (
            "if message.position < state.position:\n"
            "    teach(turn, sender, message.position.open)\n"
            "    return"
        ),
        "pass",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a vote promises nothing",
        "runtime.protocol.electing.on_candidacy",
        "turn.promise(epoch)",
        "pass",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "votes of another epoch count",
        "runtime.protocol.electing.on_vote",
        "isinstance(state.office, Candidate) and message.epoch == state.promised",
        "isinstance(state.office, Candidate)",
        (ELECTIONS,),
    ),
    Mutant(
        "who hears its coordinator supports another",
        "runtime.protocol.electing.on_canvass",
        "leader is None or leader == sender",
        "leader != state.pid",
        (ELECTIONS,),
    ),
    Mutant(
        "one voice elects",
        "runtime.protocol.electing._count",
        "len(voters) >= turn.setup.majority",
        "voters",
        (ELECTIONS, EXPLORATION),
    ),
    Mutant(
        "a coordinator that hears nobody stays",
        "runtime.protocol.coordinating.check_majority",
        "len(desk.heard | {state.pid}) < turn.setup.majority",
        "not desk.heard | {state.pid}",
        (ELECTIONS,),
    ),
    Mutant(
        "nobody is told that it has a twin",
        "runtime.protocol.committing._end_if_over",
        "state.roster[state.pid] > state.incarnation",
        "state.roster[state.pid] < 0",
        (ELECTIONS,),
    ),
    Mutant(
        "epochs belong to nobody",
        "runtime.protocol.electing.on_candidacy",
        "setup.coordinator(epoch) != sender or epoch < state.promised",
        "epoch < state.promised",
        (ELECTIONS,),
    ),
    Mutant(
        "a history has no beginning",
        "runtime.protocol.messages.digest",
        "encode(entry)",
        "encode((entry.decision, entry.admitted, entry.late))",
        (ROUNDS,),
    ),
    Mutant(
        "what a robot ran last is forgotten",
        "runtime.protocol.committing._last_ran",
        "entry.round",
        "entry.round - 1",
        (ELECTIONS, CHAOS),
    ),
)

#: What lets a stranger in, or keeps a friend out.
WIRE_MISTAKES = (
    Mutant(
        "nobody looks at the proof",
        "runtime.wire.frames.Seal.take_off",
        "not compare_digest(proof.digest(), datagram[end:])",
        "len(proof.digest()) != len(datagram[end:])",
        (WIRE,),
    ),
    Mutant(
        "the header is not covered by the proof",
        "runtime.wire.frames.Seal.take_off",
        "datagram[:end]",
        "datagram[HEADER_BYTES:end]",
        (WIRE,),
    ),
    Mutant(
        "the key is the same for every run",
        "runtime.wire.frames.session_key",
        "run.encode()",
        "b''",
        (WIRE,),
    ),
    Mutant(
        "replays are let in",
        "runtime.wire.codec.Window.is_new",
        "ahead <= -WIDTH or self.seen & bit",
        "ahead <= -WIDTH",
        (WIRE,),
    ),
    Mutant(
        "what is older than the window is let in",
        "runtime.wire.codec.Window.is_new",
        "ahead <= -WIDTH or self.seen & bit",
        "ahead > -WIDTH and self.seen & bit",
        (WIRE,),
    ),
    Mutant(
        "a robot is replayed from before its restart",
        "runtime.wire.codec.Window.is_new",
        "if incarnation < self.incarnation:\n    return False",
        "pass",
        (WIRE,),
    ),
    Mutant(
        "pieces of two messages are mixed",
        "runtime.wire.codec.Assembly.add",
        "frame.number - piece",
        "0",
        (WIRE,),
    ),
    Mutant(
        "unfinished messages pile up",
        "runtime.wire.codec.Assembly.add",
        "self.most_bytes",
        "self.most_bytes * 1_000_000",
        (WIRE,),
    ),
    Mutant(
        "datagrams grow with their message",
        "runtime.wire.codec.cut",
        '[body[at : at + ROOM] for at in range(0, len(body), ROOM)] or [b""]',
        "[body]",
        (WIRE,),
    ),
    Mutant(
        "robots that do not exist are believed in",
        "runtime.wire.bodies._fits",
        "0 <= robot < robots",
        "0 <= robot",
        (WIRE,),
    ),
    Mutant(
        "nonsense with the right key raises",
        "runtime.wire.bodies.message_of",
        "(msgspec.MsgspecError, ValueError, RecursionError)",
        "KeyError",
        (WIRE,),
    ),
    Mutant(
        "values of other languages are let in",
        "runtime.encoding.plain",
        'raise NotPlainError(f"a {type(value).__name__}")',
        "return None",
        (WIRE,),
    ),
    Mutant(
        "great numbers lose their sign",
        "runtime.encoding.big_int",
        'int.from_bytes(data, "big", signed=True)',
        'int.from_bytes(data, "big", signed=False)',
        (WIRE,),
    ),
)
