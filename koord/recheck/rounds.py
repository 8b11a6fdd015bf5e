"""Prefixes of a round: the events that robots have run so far, and their result.

``q`` is a configuration inside a round that started in ``c``: some robots have run an event, the
others have not (or have skipped, which looks alike). Everything that a robot did it did on ``c``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.claims import Claim, Goal, History, ShownTerm, as_facts, parts, stated
from koord.recheck.races import Racing, WrittenPart
from koord.recheck.storage import Robot, State
from koord.recheck.terms import BOOL, Term, Terms
from koord.recheck.turns import EventTurn, Turns
from koord.recheck.world import Key


class EventChoice(Struct, frozen=True):
    """A robot's event in a round, and the unknown that says whether it has run it."""

    turn: EventTurn
    runs: Term


class Prefix(Struct, frozen=True):
    """A prefix of a round: ``state`` is its result. ``facts`` say that it is legal."""

    start: State
    choices: tuple[tuple[EventChoice, ...], ...]  #: by robot, by event
    state: State
    facts: tuple[Term, ...]

    def ran_none(self, robot: int, turns: Turns) -> Term:
        t = turns.v.t
        return t.negation(t.disjunction(choice.runs for choice in self.choices[robot]))


class Rounds(Struct, frozen=True):
    """A builder of rounds, and of the claims about their configurations."""

    turns: Turns

    # --- robots that have moved -----------------------------------------------------------------

    def prefix(self, start: State, label: str) -> Prefix:
        """Any legal prefix of a round from ``start``, up to the whole of it."""
        world, v = self.turns.world, self.turns.v
        t = v.t
        facts: list[Term] = []
        choices: list[tuple[EventChoice, ...]] = []
        for i in range(len(world.kinds)):
            mine = []
            for position, event in enumerate(world.agent(i).events):
                turn = self.turns.turn(start, i, position)
                runs = v.symbol(f"{i} runs {event.name} in {label}", BOOL)
                facts.append(t.implies(runs, self.turns.may_run(start.robots[i], turn)))
                mine.append(EventChoice(turn, runs))
            facts += _at_most_one(t, [choice.runs for choice in mine])
            choices.append(tuple(mine))
        facts += self._one_winner_each(choices)
        flat = [choice for mine in choices for choice in mine]
        exclusive = frozenset(
            d.variable.slot
            for d in world.program.allwrite
            if world.guarding(d.variable.slot) is not None
        )
        racing = Racing(self.turns.s, label, exclusive)
        parts = [WrittenPart(choice.turn.robot, choice.runs, choice.turn.writes) for choice in flat]
        store = racing.joined(start.store, parts)
        robots = tuple(self._moved(start.robots[i], mine) for i, mine in enumerate(choices))
        return Prefix(start, tuple(choices), State(robots, store), (*facts, *racing.facts))

    def _one_winner_each(self, choices: Sequence[Sequence[EventChoice]]) -> list[Term]:
        """The fact that no two robots enter one lock class. [ATOMIC]"""
        t = self.turns.v.t
        facts: list[Term] = []
        for lock in self.turns.world.program.lock_classes:
            entering = [self._enters(mine, lock.index) for mine in choices]
            facts += _at_most_one(t, entering)
        return facts

    def _enters(self, mine: Sequence[EventChoice], lock: int) -> Term:
        t = self.turns.v.t
        return t.disjunction(
            t.both(choice.runs, choice.turn.entered[lock])
            for choice in mine
            if lock in choice.turn.entered
        )

    def taken(self, prefix: Prefix, lock: int) -> Term:
        """The condition that one of the robots that ran has entered the class."""
        return self.turns.v.t.disjunction(self._enters(mine, lock) for mine in prefix.choices)

    def _moved(self, own: Robot, mine: Sequence[EventChoice]) -> Robot:
        """A robot after the event that it ran, or unchanged. [END-EVENT] [SKIP]"""
        merged = Robot(own.locals, own.ports, own.asked, own.stopped, self.turns.v.t.integer(-1))
        for choice in mine:
            agent, after = self.turns.world.agent(choice.turn.robot), choice.turn.after
            merged = self.turns.s.merge_robots(choice.runs, after, merged, agent)
        return merged

    # --- the end of the program turns -----------------------------------------------------------

    def stopped_together(self, state: State) -> tuple[Term, State]:
        """The condition that no robot is running, and the configuration with all stopped.
        [END-PROG]
        """
        t = self.turns.v.t
        idle = t.conjunction([t.either(r.asked, r.stopped) for r in state.robots])
        robots = tuple(replace(r, stopped=t.either(r.stopped, idle)) for r in state.robots)
        return idle, State(robots, state.store)

    def skips_legally(
        self, prefix: Prefix, *, mover: EventTurn | None = None, nobody_moved: bool = False
    ) -> list[Term]:
        """Per robot, the condition that it was allowed to skip if it ran nothing. [SKIP]

        ``mover`` runs on top of the prefix. With ``nobody_moved`` each says whether that robot may
        be the first to move, and skip.
        """
        t = self.turns.v.t
        facts = []
        for i, mine in enumerate(prefix.choices):
            urgent = [choice.turn for choice in mine if choice.turn.event.urgent]
            if nobody_moved:
                free = [self.turns.off(turn) for turn in urgent]
            else:
                taken = partial(self.taken, prefix)
                free = [self.turns.not_obliged(turn, taken, mover) for turn in urgent]
            may_skip = t.either(prefix.start.robots[i].stopped, t.conjunction(free))
            if nobody_moved:
                facts.append(may_skip)
            elif mover is None or mover.robot != i:
                facts.append(t.implies(prefix.ran_none(i, self.turns), may_skip))
        return facts

    def ended(
        self, past: History, assumed: Sequence[Claim], label: str
    ) -> tuple[Prefix, State, list[Term]]:
        """The end of a round's program turns, with facts about it."""
        prefix = self.prefix(past.state, label or "the round")
        facts = self.skips_legally(prefix)
        _, end = self.stopped_together(prefix.state)
        facts += as_facts(self.goals(end, assumed))
        return prefix, end, facts

    # --- configurations --------------------------------------------------------------------------

    def anything_like(self, state: State, changed: frozenset[Key], suffix: str) -> State:
        """An arbitrary configuration that agrees with another, except in some variables."""
        kinds, any_robot = self.turns.world.kinds, self.turns.any_robot
        robots = tuple(
            any_robot(own, kinds[i], changed, f"@{i}{suffix}") for i, own in enumerate(state.robots)
        )
        return State(robots, self.turns.any_store(state.store, changed, suffix))

    def goals(
        self, state: State, claims: Iterable[Claim], *, between_rounds: bool = False
    ) -> list[Goal]:
        """Statements as goals in a configuration."""
        return stated(self.turns, state, claims, between_rounds=between_rounds)

    def parts(self, state: State, suffix: str = "") -> Iterator[ShownTerm]:
        """The variables of a configuration, part by part."""
        return parts(self.turns.world, self.turns.v, state, suffix)


def _at_most_one(t: Terms, conditions: Sequence[Term]) -> list[Term]:
    return [t.negation(t.both(a, b)) for k, a in enumerate(conditions) for b in conditions[k + 1 :]]
