"""Legal choices: each is one that the constraints allow, and all that these allow are left."""

from __future__ import annotations

from itertools import product
from random import Random

from koord.verify.engines.bits.circuit import Circuit, Latch
from koord.verify.engines.bits.clauses import QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import narrowed
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery
from koord.verify.engines.bits.legal_choices import choices_of, with_legal_choices
from tests.verify.engines.bits.test_constraint_selection import circuits

#: So many rounds and mistakes of each query are looked for in the other.
SOME = 6


def queries() -> list[tuple[int, Circuit, SafetyQuery, SafetyQuery]]:
    """Queries of generated programs, by their seeds, each with what is made of it."""
    found = []
    for seed, circuit in circuits():
        asked = narrowed(circuit, list(circuit.bad), (), between=True)
        made = with_legal_choices(circuit.d.graph, asked, choices_of(circuit))
        found.append((seed, circuit, asked, made))
    return found


def test_every_round_is_one_of_legal_choices_with_the_same_end() -> None:
    for seed, circuit, asked, made in queries():
        g = circuit.d.graph
        clauses = Clauses(g, QUICK)
        for literal in (asked.steps, made.steps):
            assert not clauses.solve([clauses.of(asked.steps), -clauses.of(literal)]), seed
        for one, other in zip(asked.latches, made.latches, strict=True):
            apart = g.differ(one.next, other.next)
            assert not clauses.solve([clauses.of(asked.steps), clauses.of(apart)]), seed
        assert not clauses.solve([clauses.of(asked.bad), -clauses.of(made.bad)]), seed
        clauses.close()


def test_legal_choices_make_rounds_and_mistakes_that_there_were() -> None:
    """What is reached from a state by legal choices is reached from it by other inputs as well."""
    rounds = mistakes = 0
    for seed, circuit, asked, made in queries():
        g, random = circuit.d.graph, Random(seed)
        inputs = _inputs(g, made)
        judge = Clauses(g, QUICK)
        before = [judge.of(latch.literal) for latch in asked.latches]
        after = [judge.of(latch.next) for latch in asked.latches]
        steps, bad = judge.of(asked.steps), judge.of(asked.bad)
        for _ in range(SOME):
            for goal in (made.steps, made.bad):
                given = _some(g, goal, inputs, random)
                if given is None:
                    continue
                roots = [latch.literal for latch in made.latches]
                state = _signed(before, g.values(roots, given))
                if goal == made.bad:
                    assert judge.solve([bad, *state]), seed
                    mistakes += 1
                else:
                    then = g.values([latch.next for latch in made.latches], given)
                    assert judge.solve([steps, *state, *_signed(after, then)]), seed
                    rounds += 1
        judge.close()
    assert rounds >= 60
    assert mistakes >= 10


def test_guards_and_races_need_no_constraints_any_more() -> None:
    fewer = none = 0
    for _, circuit, asked, made in queries():
        g = circuit.d.graph
        fewer += len(g.conjuncts(made.steps)) < len(g.conjuncts(asked.steps))
        none += made.steps == TRUE and asked.steps != TRUE
    assert fewer >= 8
    assert none >= 5


def test_a_choice_that_nothing_allows_is_never_made() -> None:
    g = Graph()
    one, other, guard = (g.input(name) for name in "abc")
    both = g.both(one, other) ^ 1  # at most one of them
    guarded = g.both(other, guard ^ 1) ^ 1
    question = SafetyQuery((), TRUE, g.all_of([both, guarded, one]), g.all_of([other, both]))
    made = with_legal_choices(g, question, (one >> 1, other >> 1))
    assert made.steps == one  # which is no constraint that holds where it is not chosen
    # A mistake has its own constraints: of the guard it knows nothing, and alone is whoever errs.
    assert g.values([made.bad], {other >> 1: True, guard >> 1: False}) == [True]
    assert made.bad == other
    never = SafetyQuery((), TRUE, one ^ 1, FALSE)
    assert with_legal_choices(g, never, (one >> 1,)).steps == TRUE


def test_a_constraint_of_many_choices_is_shared_among_them() -> None:
    """Whoever may choose one of two excludes another's choices: none of the four is free of it."""
    g = Graph()
    a, b, c, d = (g.input(name) for name in "abcd")
    apart = g.both(g.either(a, b), g.either(c, d)) ^ 1
    latches = tuple(Latch(f"l{x}", g.input(f"l{x}"), FALSE, x) for x in (a, b, c, d))
    made = with_legal_choices(
        g, SafetyQuery(latches, TRUE, apart, FALSE), [x >> 1 for x in (a, b, c, d)]
    )
    assert made.steps == TRUE
    for chosen in product((False, True), repeat=4):
        given = dict(zip((x >> 1 for x in (a, b, c, d)), chosen, strict=True))
        then = g.values([latch.next for latch in made.latches], given)
        assert not ((then[0] or then[1]) and (then[2] or then[3]))
        if g.values([apart], given) == [True]:
            assert tuple(then) == chosen


def test_a_constraint_that_requires_a_choice_is_left() -> None:
    """Of two that are made together, neither counts as not made."""
    g = Graph()
    a, b = g.input("a"), g.input("b")
    for part in (g.either(a ^ 1, b), g.differ(a, b) ^ 1):
        made = with_legal_choices(g, SafetyQuery((), TRUE, part, FALSE), [a >> 1, b >> 1])
        assert made.steps == part


def _inputs(g: Graph, made: SafetyQuery) -> list[int]:
    roots = [made.steps, made.bad, *(latch.next for latch in made.latches)]
    own = [latch.literal for latch in made.latches]
    return [node for node in g.cone([*roots, *own]) if g.is_input(node)]


def _some(g: Graph, goal: int, inputs: list[int], random: Random) -> dict[int, bool] | None:
    """Values of inputs with which a literal holds, close to ones by chance, or None."""
    clauses = Clauses(g, QUICK)
    numbers = {node: clauses.of(2 * node) for node in inputs}
    if not clauses.solve([clauses.of(goal)]):
        clauses.close()
        return None
    held = [clauses.of(goal)]
    for node in random.sample(inputs, len(inputs)):
        wish = numbers[node] if random.random() < 0.5 else -numbers[node]
        held.append(wish if clauses.solve([*held, wish]) else -wish)
    clauses.close()
    return {node: numbers[node] in held for node in inputs}


def _signed(numbers: list[int], values: list[bool]) -> list[int]:
    return [x if value else -x for x, value in zip(numbers, values, strict=True)]
