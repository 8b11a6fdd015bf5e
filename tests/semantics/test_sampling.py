"""What a run makes up where the program leaves it open, and who chooses the next step."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.sampling import initial_state_search
from koord.sampling.library import (
    CLEARANCE_M,
    Point,
    along,
    host,
    on_path,
    paths_clear,
    segments_apart,
    square_root,
)
from koord.sampling.policies import AtRandom, First, take
from koord.sampling.running import ProgramTurn
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Concrete
from koord.semantics.values import Seq
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, FLOAT, INT, POS, ListType, Type
from koord.traces.codec import encode
from koord.traces.json_reader import JsonNode
from koord.traces.replay import replay
from koord.traces.trace import Numbers
from koord.traces.value_codec import decode_value, encode_value
from tests.loading import example_program, program_of
from tests.sampling import examples, first
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    TRUE,
    Build,
    I,
    J,
    bound,
    contract,
    e,
    forall,
    length,
    output,
    pos,
    ran,
    stopped,
    when,
)
from tests.semantics.driving import drive, played
from tests.semantics.strategies import types

EXAMPLES = Path(__file__).parents[2] / "specs/examples"


def sampler(seed: int = 0, numbers: Numbers = Numbers.EXACT, robots: int = 3) -> Sampler:
    return Sampler(dealt(programs.collections(), robots), numbers, Random(seed))


def refusal(code: str, run: Callable[[], object]) -> str:
    """The message of the one diagnostic that a run ends with."""
    with pytest.raises(KoordError) as caught:
        run()
    (found,) = caught.value.diagnostics
    assert found.code == code
    assert found.hint
    return found.message


# --- values -------------------------------------------------------------------------------------


@given(type_=types, seed=st.integers(0, 2**32), numbers=st.sampled_from(Numbers))
@examples(200)
def test_values_are_of_their_type(type_: Type, seed: int, numbers: Numbers) -> None:
    """[VALUE] [DOMAIN]"""
    value = sampler(seed, numbers).value(type_)
    text = json.dumps(encode_value(value, type_))
    assert decode_value(JsonNode(json.loads(text)), type_, 3, numbers) == value


def test_values_hang_on_the_seed() -> None:
    """[RECORDING]: the same generator, the same values; another, others."""
    type_ = ListType(POS)

    def drawn(seed: int) -> list[Concrete]:
        source = sampler(seed)
        return [source.value(type_, length=3) for _ in range(5)]

    assert drawn(1) == drawn(1) != drawn(2)


@given(
    low=st.fractions(-100, 100),
    width=st.fractions(0, 100),
    seed=st.integers(0, 1000),
    numbers=st.sampled_from(Numbers),
)
def test_choices_lie_between_their_bounds(
    low: Fraction, width: Fraction, seed: int, numbers: Numbers
) -> None:
    """[CHOOSE]: both included, in both domains."""
    source = sampler(seed, numbers)
    least, most = source.real(low), source.real(low + width)
    assert not isinstance(least, str)
    assert not isinstance(most, str)
    chosen = source.between(least, most, FLOAT)
    assert not isinstance(chosen, str)
    assert least <= chosen <= most


def test_choices_of_ints_reach_every_value() -> None:
    """[CHOOSE]"""
    source = sampler()
    assert {source.between(-1, 2, INT) for _ in range(200)} == {-1, 0, 1, 2}
    assert source.between(5, 4, INT) == 5


# --- assumptions --------------------------------------------------------------------------------


def distinct_starts(robots: int, seed: int) -> list[str]:
    b = Build()
    x = b.local("x", INT, core.Start.ARBITRARY)
    b.event("Nothing", x > 99)
    b.assume(forall(I, forall(J, I.ne(J) >> x.at(I).ne(x.at(J)))))
    b.assume(forall(I, (x.at(I) >= 0) & (x.at(I) < I * 3 + 3)))
    return drive(b.program(), robots, seed=seed).each("x")


@pytest.mark.parametrize("seed", first(1, range(5)))
def test_starts_meet_the_assumptions(seed: int) -> None:
    """[INIT] [PROP-ASSUME]: also where hardly any of many values do."""
    found = [int(x) for x in distinct_starts(10, seed)]
    assert len(set(found)) == 10
    assert all(0 <= x < 3 * i + 3 for i, x in enumerate(found))


def test_an_assumption_may_say_what_a_start_is() -> None:
    """[PROP-ASSUME]: by an equation, through a function, for a part of a record."""
    b = Build()
    p, k = bound("p", 0, INT), bound("k", 1, INT)
    b.function("place", [p], POS, core.Return(pos(p.widened() * 3, -1, 7).expr))
    where = b.sensor("where", POS)
    xs = b.local("xs", ListType(INT), core.Start.ARBITRARY)
    y = b.allwrite("y", FLOAT, core.Start.ARBITRARY)
    b.module()
    b.event("Nothing", TRUE)
    b.assume(forall(I, where.at(I).eq(b.call("place", I))))
    b.assume((y * 2).eq(Fraction(123457)) & (y > 100), bound=0)
    first = core.IntRange(e(0, INT).expr, e(1, INT).expr)
    b.assume(forall(I, forall(k, xs.at(I)[k].eq(4321), first)))
    d = drive(b.program(), 2)
    assert d.each("Unit.where") == ["(0, -1, 7)", "(3, -1, 7)"]
    assert d.shared("y") == "61728.5"
    assert d.own(1, "xs").startswith("[4321")


def test_elements_of_a_list_are_mended_one_by_one() -> None:
    """[PROP-ASSUME] [E-QUANT]"""
    b = Build()
    tasks = b.allwrite("tasks", ListType(programs.TASK), core.Start.ARBITRARY)
    t = bound("t", 0, programs.TASK)
    b.event("Nothing", TRUE)
    free = ~t.field("assigned") & t.field("id").eq(-777)
    b.assume(forall(t, free, core.Elements(tasks.expr)), bound=1)
    b.assume(length(tasks) >= 2, bound=0)
    shown = drive(b.program(), 2).shared("tasks")
    assert shown.count("assigned = false, id = -777") >= 2
    assert "true" not in shown


def test_a_declared_length_is_kept() -> None:
    """[INIT]"""
    b = Build()
    xs = b.local("xs", ListType(INT), core.Start.ARBITRARY)
    b.event("Nothing", length(xs) > 9)
    made = b.program()
    entry = core.Declaration(xs.place.variable, core.Start.ARBITRARY, length=7)
    agent = made.agents[0]
    program = replace(made, agents=(replace(agent, locals=(entry,)),))
    assert drive(program, 1).own(0, "xs").count(",") == 6


def test_contradictory_assumptions_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """[PROP-ASSUME]: after a bounded number of tries, by name."""
    monkeypatch.setattr(initial_state_search, "START_TRIES", 200)
    b = Build()
    x = b.local("x", INT, core.Start.ARBITRARY)
    b.event("Nothing", TRUE)
    b.assume(forall(I, (x.at(I) > 0) & (x.at(I) < 1)), "Odd")
    message = refusal("K920", lambda: drive(b.program(), 1))
    assert "meets the assumption Odd" in message
    assert "tries" in message
    # Without a name of its own it has one that nobody wrote.
    b.assumptions[0] = replace(b.assumptions[0], name="assume_1")
    assert "that meets this assumption" in refusal("K920", lambda: drive(b.program(), 1))


def test_assumptions_about_fixed_starts_are_told_at_once() -> None:
    """[PROP-ASSUME]"""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Nothing", TRUE)
    b.assume(forall(I, x.at(I).eq(1)), "One")
    assert "tries" not in refusal("K920", lambda: drive(b.program(), 1))


# --- sensors ------------------------------------------------------------------------------------


@pytest.mark.parametrize("numbers", Numbers)
def test_readings_follow_contracts_with_equations(numbers: Numbers) -> None:
    """[ENV-FREE] [ENV-CONTRACT]: even where only one value is allowed."""
    b = Build()
    x, y = b.sensor("x", FLOAT, 3), b.sensor("y", FLOAT, 0)
    halved = contract("Halved", [], [(x.primed * 2).eq(x), y.primed.eq(x.primed + 10)])
    b.module(contracts=[halved])
    b.event("Nothing", TRUE)
    d = drive(b.program(), 2, numbers=numbers).round(None, None).round(None, None)
    assert d.each("Unit.x") == ["0.75", "0.75"]
    assert d.each("Unit.y") == ["10.75", "10.75"]


def test_contradictory_contracts_are_told() -> None:
    """[ENV-CONTRACT]: with robot, round and contract."""
    d = drive(programs.rover(contradictory=True), 2).skip(0, 1)
    message = refusal("K922", d.env)
    assert "no reading of robot 0 in round 1" in message
    assert "contract Never" in message


def test_sensors_without_contracts_read_anything() -> None:
    """[ENV-FREE]"""
    b = Build()
    x = b.sensor("x", INT, 0)
    b.module()
    b.event("Nothing", x > 99)
    d = drive(b.program(), 3)
    seen = {x for _ in range(10) for x in d.round(None, None, None).each("Unit.x")}
    assert len(seen) > 4


def test_a_vehicle_follows_its_path() -> None:
    """[ENV-FREE]: the stand-in for the library's Motion arrives, and stays on the path."""
    text = (
        "using Motion\ninit:\n"
        "  Motion.path = [Motion.psn, pos(3.0, 0.0, 0.0), pos(3.0, 2.0, 0.0)]\n"
        "assume: Motion.psn == pos(0.0, 0.0, 0.0) and not Motion.reached\n"
        "Nothing:\n  pre: false\n  eff: stop\n"
    )
    d = drive(program_of(text), 2)
    places = [d.own(1, "Motion.psn")]
    while d.own(1, "Motion.reached") == "false":
        places.append(d.round(None, None).own(1, "Motion.psn"))
    assert (places[0], places[-1]) == ("(0, 0, 0)", "(3, 2, 0)")
    assert 5 <= len(places) <= 8
    assert all(", 0, 0)" in place or place.startswith("(3, ") for place in places)


# --- external functions -------------------------------------------------------------------------


def test_mathematical_functions_answer_alike_and_fresh_ones_anew() -> None:
    """[EXTERNAL]: for the whole run and for every robot."""
    d = drive(programs.external_planner(), 3)
    for _ in range(6):
        d.round("Ask", "Ask", "Ask")
    answers = [a for r in d.run.recording().rounds for a in r.answers]
    assert len({a.value for a in answers if a.function == "above"}) == 1
    rolls = [a.value for a in answers if a.function == "dice"]
    assert set(rolls) <= set(range(1, 7))
    assert len(set(rolls)) > 2


def test_no_answer_is_told_with_function_and_arguments() -> None:
    """[EXTERNAL]: after a bounded number of tries."""
    b = Build()
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("never", [n], up, ensures=[up > n, up < n])
    x = b.local("x", INT, 0)
    b.event("Ask", TRUE, x.set(b.ask("never", 3)))
    message = refusal("K921", lambda: drive(b.program(), 1).go(0, "Ask"))
    assert "never(3)" in message
    assert "400 tries" in message


def test_answers_are_mended_as_their_summary_asks() -> None:
    """[EXTERNAL]: such answers would not be hit upon."""
    program = program_of("""
using Motion
def fun route(pos a, pos b) -> pos[]: extern
  ensures: length(result) == 6 and result[0] == a and result[length(result) - 1] == b
def fun other(int k) -> int: extern
  ensures: 1000 < result and result < 1010 and forall i: i != k implies other(i) != result
local:
  pos[] r = []
  int n = 0
Go:
  eff:
    r = route(Motion.psn, pos(1, 1, 1))
    n = other(pid)
""")
    d = drive(program, 2).round("Go", "Go").round("Go", "Go")
    answers = [a for r in d.run.recording().rounds for a in r.answers]
    ways = [a for a in answers if a.function == "route"]
    assert ways
    for way in ways:
        assert isinstance(way.value, Seq)
        assert (way.value.length, len(way.value.items)) == (6, 6)
        assert (way.value.items[0], way.value.items[-1]) == way.arguments
    others = {a.arguments: a.value for a in answers if a.function == "other"}
    assert len(others) == len(set(others.values())) == 2


def test_an_unmet_requirement_is_a_fault_and_no_search() -> None:
    """[EXTERNAL] [FAULT]"""
    b = Build()
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("never", [n], up, requires=[n > 0], ensures=[up > n, up < n])
    x = b.local("x", INT, 0)
    b.event("Ask", TRUE, x.set(b.ask("never", 0)))
    d = drive(b.program(), 1).go(0, "Ask")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind.name == "PRECONDITION"


def test_a_summary_may_mention_its_own_function() -> None:
    """[EXTERNAL]: a symmetric one is answered symmetrically."""
    b = Build()
    n, m, same = bound("n", 0, INT), bound("m", 1, INT), bound("result", 2, BOOL)
    b.external("near", [n, m], same)
    symmetric = core.Binary(
        core.BinaryOp.EQ,
        same.expr,
        core.ExternalCall("near", (m.expr, n.expr), BOOL, 99),
        BOOL,
    )
    b.externals[0] = replace(b.externals[0], ensures=(symmetric,))
    x = b.allread("x", BOOL, False)
    b.event("Ask", TRUE, x[PID].set(b.ask("near", PID, (PID + 1) % 2)))
    for seed in range(8):
        d = drive(b.program(), 2, seed=seed).round("Ask", "Ask")
        assert d.shared("x") in ("[true, true]", "[false, false]")
        assert replay(d.trace()).refused is None


def test_fixed_answers_are_forgotten_between_runs_only() -> None:
    """[RECORDING]: within a round one key has one answer, whoever asks how often."""
    source = sampler()
    inputs = SampledInputs(source)
    oracle = inputs.oracle(Phase.ENV, 1)
    first = oracle.choose((4,), 0, 10**6, INT)
    assert oracle.choose((4,), 0, 10**6, INT) == first
    assert inputs.oracle(Phase.ENV, 2).choose((4,), 0, 10**6, INT) != first
    inputs.forget_round()
    assert inputs.recorded_answers() == ()


# --- the library's functions --------------------------------------------------------------------

LIBRARY = """\
using Motion
local:
  float r = 0.0
  bool b = false
  pos[] path = []
  pos there = pos(0.0, 0.0, 0.0)
  Map<int, bool> world = {}
  Task t = Task(loc = pos(1.0, 2.0, 0.0))
Ask:
  pre: true
  eff:
    r = sqrt(r * r + 2)
    r = r + norm(there) + distance(there, pos(3.0, 4.0, 0.0))
    path = findPath(there, pos(1.0, 1.0, 0.0))
    b = pathIsClear(path, [there])
    path = findPath(there, t.loc, path)
    path = getPathFromTask(t)
    b = willCollide(t)
    world = merge(world, scanToMap(path))
    there = pickFrontierPos(world, there)
    path = findObs(world)
"""


@pytest.mark.parametrize("numbers", Numbers)
def test_every_function_of_the_library_has_an_implementation(numbers: Numbers) -> None:
    """[EXTERNAL]: its answers meet its summary in both domains, call after call."""
    program = program_of(LIBRARY)
    assert len(program.externals) >= 7
    assert all(host(function) is not None for function in program.externals)
    d = drive(program, 2, numbers=numbers)
    for _ in range(5):
        d.round("Ask", "Ask")
    assert d.configuration.fault is None
    assert replay(d.trace()).refused is None


def test_an_own_function_with_a_library_name_is_its_own() -> None:
    """[EXTERNAL]: another type, another function."""
    program = program_of(
        "def fun sqrt(int n) -> int: extern\n  ensures: result == -7\n"
        "local:\n  int x = 0\nAsk:\n  pre: true\n  eff: x = sqrt(4)\n"
    )
    assert all(host(function) is None for function in program.externals)
    assert drive(program, 1).go(0, "Ask").own(0, "x") == "-7"


@given(st.fractions(0, 10**12))
def test_roots_meet_their_summary(x: Fraction) -> None:
    """[EXTERNAL]: within 2⁻⁴⁰ of the square, and short."""
    root = square_root(x)
    assert root >= 0
    assert abs(root * root - x) <= x / 2**40
    exact = root * root == x
    assert exact or root.denominator & (root.denominator - 1) == 0


@given(st.fractions(0, 10**6))
def test_roots_of_squares_are_exact(x: Fraction) -> None:
    """[EXTERNAL]"""
    assert square_root(x * x) == x


coordinates = st.integers(-4, 4).map(Fraction)
points = st.tuples(coordinates, coordinates, coordinates)


def between(a: Point, b: Point, share: Fraction) -> Point:
    x, y, z = (p + (q - p) * share for p, q in zip(a, b, strict=True))
    return x, y, z


def apart(a: Point, b: Point) -> Fraction:
    return sum(((p - q) ** 2 for p, q in zip(a, b, strict=True)), Fraction(0))


@given(points, points, points, points)
@examples(200)
def test_the_distance_of_segments_is_the_least_of_their_points(
    a: Point, b: Point, c: Point, d: Point
) -> None:
    """[EXTERNAL]: no two sampled points are nearer, and some are as near, up to the sampling."""
    least = segments_apart(a, b, c, d)
    shares = [Fraction(k, 12) for k in range(13)]
    sampled = min(apart(between(a, b, s), between(c, d, t)) for s in shares for t in shares)
    assert least <= sampled
    step = (float(apart(a, b)) ** 0.5 + float(apart(c, d)) ** 0.5) / 24
    assert float(sampled) ** 0.5 <= float(least) ** 0.5 + step + 1e-9
    assert least == segments_apart(c, d, a, b) == segments_apart(b, a, c, d)


def test_paths_that_cross_are_not_clear() -> None:
    """[EXTERNAL]"""

    def path(*xy: tuple[int, int]) -> list[Point]:
        return [(Fraction(x), Fraction(y), Fraction(0)) for x, y in xy]

    assert not paths_clear(path((0, 0), (2, 2)), path((0, 2), (2, 0)))
    assert not paths_clear(path((0, 0), (2, 0)), path((1, 0), (3, 0)))
    assert paths_clear(path((0, 0), (2, 0)), path((0, 1), (2, 1)))
    assert paths_clear([], path((0, 0)))
    limit = [(Fraction(0), CLEARANCE_M, Fraction(0))]
    assert not paths_clear(path((0, 0)), limit)


@given(st.lists(points, min_size=1, max_size=4), st.fractions(Fraction(1, 10), 3))
def test_vehicles_stay_on_their_path_and_arrive(path: list[Point], step: Fraction) -> None:
    """[EXTERNAL]: exactly, with short numbers."""
    here = path[0]
    total = sum(float(apart(a, b)) ** 0.5 for a, b in pairwise(path))
    assume(total < 30)
    for _ in range(int(total / float(step)) + 2):
        here = along(path, here, step)
        assert on_path(here, path)
        assert all(c.denominator <= 1024 for c in here)
    assert here == path[-1] or _loops(path)


def _loops(path: list[Point]) -> bool:
    """Whether a path meets itself: then the nearest piece need not be the one the robot is on."""
    pieces = list(pairwise(path))
    return any(
        segments_apart(*pieces[i], *pieces[j]) == 0
        for i in range(len(pieces))
        for j in range(i + 2, len(pieces))
    ) or any(a == b or segments_apart(a, b, c, c) == 0 for (a, b), (_, c) in pairwise(pieces))


# --- policies -----------------------------------------------------------------------------------


@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
def test_runs_hang_on_the_seed(program: core.Program) -> None:
    """[RECORDING]: the same seed, the same trace, to the last byte."""

    def made(seed: int) -> bytes:
        rng = Random(seed)
        return encode(played(program, AtRandom(rng), rng=rng)[1])

    assert made(5) == made(5)


def test_the_first_policy_is_what_the_runtime_does() -> None:
    """[SELECT] [ATOMIC]: robots in order, the first enabled event, and a lost lock is a skip."""
    _, trace = played(programs.lock_demo(), First(), rounds=2)
    assert [r.order for r in trace.recording.rounds] == [(0, 1, 2)] * 2
    assert [r.events for r in trace.recording.rounds] == [(0, None, None)] * 2


def test_a_lost_lock_is_told() -> None:
    """[ATOMIC] [SKIP]"""
    d = drive(programs.lock_demo(), 2)
    assert take(d.run, ProgramTurn(0, 2)).lost is None
    taken = take(d.run, ProgramTurn(1, 1))
    assert (taken.lost, taken.step.rule) == ("Right", "SKIP")


def test_where_a_loser_may_not_skip_it_runs_another_event() -> None:
    """[SKIP] [ATOMIC]: an urgent event whose lock is free still obliges."""
    b = Build()
    x, y = b.allwrite("x", INT, 0), b.allwrite("y", INT, 0)
    b.event("Lose", TRUE, b.atomic(x.set(PID), lock=0))
    b.event("Must", TRUE, b.atomic(y.set(PID + 1), lock=1), urgent=True)
    d = drive(b.program(), 3).go(0, "Lose")
    taken = take(d.run, ProgramTurn(1, 0))
    assert (taken.lost, taken.step.event) == ("Lose", "Must")
    assert d.shared("y") == "2"
    taken = take(d.run, ProgramTurn(2, 0))
    assert (taken.lost, taken.step.rule) == ("Lose", "SKIP")


def test_random_runs_differ_in_order_events_and_skips() -> None:
    """[EVENT-TRANS] [SELECT] [SKIP]"""
    rng = Random(1)
    _, trace = played(programs.lock_demo(), AtRandom(rng), rounds=60, robots=3, rng=rng)
    rounds = trace.recording.rounds
    assert len({r.order for r in rounds}) == 6
    assert {event for r in rounds for event in r.events} == {None, 0, 1, 2, 3, 4}


def test_random_runs_do_not_skip_what_is_urgent() -> None:
    """[SKIP]"""
    rng = Random(1)
    program = programs.lock_demo(urgent=True)
    _, trace = played(program, AtRandom(rng, 100), rounds=20, rng=rng)
    assert all(r.events[r.order[0]] is not None for r in trace.recording.rounds)


def test_a_run_ends_when_everyone_has_stopped() -> None:
    """[STOP]"""
    b = Build()
    b.event("End", TRUE, core.Stop())
    play, trace = played(b.program(), First(), rounds=50)
    assert play.run.all_stopped
    assert len(trace.recording.rounds) == 1


def test_a_run_can_be_taken_back() -> None:
    """[RECORDING]: to any moment, and then goes on as if nothing had been."""
    d = drive(programs.external_planner(), 2).round("Ask", None).go(1, "Ask")
    moment, seen = d.run.moment, d.trace()
    d.go(0, "Ask").env().round("Ask", "Ask")
    d.run.go_back(moment)
    assert d.run.configuration == moment.configuration
    assert d.trace() == seen
    d.skip(0).env()
    assert d.run.round == 2
    assert replay(d.trace()).refused is None


# --- numbers that grow --------------------------------------------------------------------------


def test_numbers_that_grow_without_end_are_told() -> None:
    """[DOMAIN]: running out of memory is not a behaviour of the program."""
    b = Build()
    x = b.local("x", FLOAT, Fraction(3, 2))
    b.event("Square", TRUE, x.set(x * x))
    d = drive(b.program(), 1)

    def forever() -> None:
        while True:
            d.round("Square")

    assert "100000 bits" in refusal("K923", forever)
    double = drive(b.program(), 1, numbers=Numbers.DOUBLE)
    for _ in range(30):
        double.round("Square")
    assert double.own(0, "x") == "inf"
    assert replay(double.trace()).refused is None


# --- whole programs -----------------------------------------------------------------------------


@pytest.mark.parametrize("policy", ["first", "random"])
@pytest.mark.parametrize("name", first(8, sorted(p.stem for p in EXAMPLES.glob("*.krd"))))
def test_examples_run_and_replay(name: str, policy: str) -> None:
    """[RECORDING] [REPLAY]: a few rounds of every example, by its own text."""
    made = example_program(name)
    robots = 4 if name == "shapeform" else 3
    rng = Random(3)
    chosen = First() if policy == "first" else AtRandom(rng)
    _, trace = played(made, chosen, robots=robots, rounds=6, rng=rng)
    assert len(trace.configurations) > 1
    assert replay(trace).refused is None


def test_properties_that_hold_are_not_looked_at_twice() -> None:
    """[PROP-INVARIANT]: a configuration shares what a step left alone."""
    b = Build()
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Step", TRUE, y.set(y + 1), when(y > 3, x.set(9)), output(y))
    b.invariant("Low", forall(I, x.at(I) < 9), bound=1)
    play, _ = played(b.program(), First(), rounds=9, robots=2)
    assert play.violation is not None
    assert (play.violation.round, play.violation.robot) == (3, 0)


def test_a_property_about_what_ran_is_looked_at_again() -> None:
    """[PROP-RAN] [PROP-STOPPED]"""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Idle", TRUE)
    b.event("End", x > 99, core.Stop())
    b.invariant("NeverIdle", forall(I, ~ran(0, I)), bound=1)
    play, _ = played(b.program(), First(), robots=2)
    assert play.violation is not None
    assert (play.violation.name, play.violation.round, play.violation.robot) == ("NeverIdle", 0, 0)
    b = Build()
    b.event("End", TRUE, core.Stop())
    b.invariant("Going", forall(I, ~stopped(I)), bound=1)
    play, _ = played(b.program(), First(), robots=2)
    assert play.violation is not None
    assert play.violation.robot == 0


def test_systems_of_several_kinds_sample_for_each() -> None:
    """[CONFIG]"""
    program = programs.two_kinds()
    system = System(program, (1, 1, 0))
    _, trace = played(program, First(), system=system, rounds=3)
    assert [r.events for r in trace.recording.rounds] == [(0, 0, 0), (0, 0, 0), (0, 0, 0)]
