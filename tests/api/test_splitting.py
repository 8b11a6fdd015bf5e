"""Splitting: its rates are without bias, its intervals cover, and its runs are what they were."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from statistics import fmean, stdev

import pytest
from msgspec import Struct

import koord
from koord.api import splitting_runs
from koord.api.campaign_figures import rate
from koord.api.fitting import FitRequest, fit, fit_request
from koord.api.reseeding import Reseeding
from koord.api.splitting_method import Repetition, estimate, seeds, split
from koord.api.splitting_runs import SplitRuns, Target, target_of
from koord.sim.disturbances import Fixes, Gusts, Normals, Positioning, Wind
from koord.sim.levels import ClaimGauge
from koord.sim.running import Simulation
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from tests.sampling import first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

# --- a random walk whose probability is known -----------------------------------------------------


class At(Struct, frozen=True):
    """A mark of a walk."""

    level: float
    step: int


class Walk(Struct, frozen=True):
    """The places of a walk, and its marks."""

    places: tuple[int, ...]
    marks: tuple[At, ...]


class Walks:
    """Walks from ``start`` by one, up in one of three cases, until 0 or ``goal``.

    The probability that they come to the goal is known (gambler's ruin).
    """

    def __init__(self, start: int, goal: int, level: Callable[[int], float] = float) -> None:
        self.start, self.goal, self.level = start, goal, level
        self.branches = 0

    @property
    def probability(self) -> float:
        return float((2**self.start - 1) / (2**self.goal - 1))

    def begun(self, seed: int) -> Walk:
        return self._gone([self.start], Random(seed))

    def branched(self, particle: Walk, mark: At, seed: int) -> Walk:
        self.branches += 1
        made = self._gone([*particle.places[: mark.step + 1]], Random(seed))
        assert (
            made.marks[: particle.marks.index(mark) + 1]
            == particle.marks[: particle.marks.index(mark) + 1]
        )
        return made

    def _gone(self, places: list[int], draw: Random) -> Walk:
        while 0 < places[-1] < self.goal:
            places.append(places[-1] + draw.choice((-1, -1, 1)))
        marks = list[At]()
        for step, place in enumerate(places):
            level = math.inf if place == self.goal else self.level(place)
            if not marks or level > marks[-1].level:
                marks.append(At(level, step))
        return Walk(tuple(places), tuple(marks))


def is_near(rates: list[float], probability: float) -> bool:
    """Whether a mean is what it is to be: chance alone is off by more in 1 of 16,000 cases."""
    return abs(fmean(rates) - probability) < 4 * stdev(rates) / math.sqrt(len(rates))


@pytest.mark.parametrize(
    ("walks", "particles"),
    first(
        1,
        [
            (Walks(1, 3), 2),  # often both die out
            (Walks(1, 5, lambda place: place // 2), 6),  # many are level
            (Walks(1, 5, lambda place: (place * 3) % 5), 6),  # a level that says little
            (Walks(2, 5, lambda place: 0.0), 4),  # one that says nothing
            (Walks(1, 7), 8),
            (Walks(2, 7), 12),
        ],
    ),
)
def test_the_mean_of_rates_is_the_probability(walks: Walks, particles: int) -> None:
    rates = [split(walks, particles, 7, number).rate for number in range(1500)]
    assert is_near(rates, walks.probability)
    assert len({*rates}) > 1


@pytest.mark.slow
def test_intervals_cover_a_known_probability() -> None:
    walks, covered = Walks(1, 8), 0
    for seed in range(40):
        found = estimate([split(walks, 25, seed, number) for number in range(20)], 25)
        covered += found.low <= walks.probability <= found.high
    assert covered >= 34  # of 95 % and a little less, as rates are skewed


def test_what_is_rare_is_found() -> None:
    """A probability of 1 / 32,767, which 400 runs by chance do not meet."""
    walks = Walks(1, 15)
    steep = Walks(1, 15, lambda place: -1.0)
    rates = [split(walks, 40, 1, number) for number in range(10)]
    found = estimate(rates, 40)
    assert not any(one.broken_at_first for one in rates)
    assert found.low > 0
    assert found.low <= walks.probability <= found.high
    assert all(one.runs < 1000 for one in rates)
    assert estimate([split(steep, 40, 1, number) for number in range(10)], 40).high < 0.1


def test_where_nothing_is_found_the_first_particles_count() -> None:
    walks = Walks(1, 40, lambda place: 0.0)
    found = [split(walks, 50, 0, number) for number in range(4)]
    assert [one.rate for one in found] == [0.0] * 4
    assert [one.highest for one in found] == [0.0] * 4
    interval = estimate(found, 50)
    assert (interval.mean, interval.low) == (0.0, 0.0)
    assert interval.high == rate(0, 200).high
    always = [Repetition(1.0, 50, 50, 0, -math.inf)] * 4
    assert estimate(always, 50).low == rate(200, 200).low < estimate(always, 50).high == 1.0


def test_what_is_never_reached_ends() -> None:
    """A level that goes up for ever, and a claim that is never broken."""

    class Climbing(Walks):
        def _gone(self, places: list[int], draw: Random) -> Walk:
            height = places[-1] + draw.choice((0, 1, 2))
            places.append(height)
            marks = tuple(At(float(place), step) for step, place in enumerate(places))
            return Walk(tuple(places), marks)

    found = split(Climbing(1, 2), 4, 0, 0)
    assert found.rate == 0.0
    assert found.is_cut or found.steps


def test_no_seed_comes_twice() -> None:
    found = [
        seed for number in range(20) for seed, _ in zip(seeds(3, number), range(50), strict=False)
    ]
    assert len({*found}) == len(found)
    assert next(seeds(4, 0)) not in found


# --- runs of programs -----------------------------------------------------------------------------

#: A walk whose steps the environment draws. From 3 it comes to 12 before 0 in one of four runs.
COIN = Source(
    "coin.krd",
    """\
using Coin:
    sensors:
        int side
    environment:
        side = 2 * choose(0, 1) - 1

param int start = 3
param int goal = 12

local:
    int x = start
    bool over = false

Step:
    pre: 0 < x and x < goal
    eff: x = x + Coin.side

Over:
    pre: x <= 0 or goal <= x
    eff: stop

assume: Coin.side == 0
invariant Below: x < goal
invariant Odd: over or not over
""",
)
ONE = Source(
    "one.yaml",
    """\
agents: [{pid: 0, on_device: point}]
devices: {point: {bot_type: IDEAL, planner: STRAIGHT}}
""",
)

#: Robots that hover beside each other in gusts of wind.
HOVERING = Source(
    "hovering.krd",
    """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target

local:
    int rounds = 0

Wait:
    eff: rounds = rounds + 1

invariant Near: forall i, j: i < j implies Motion.psn@j.x - Motion.psn@i.x >= -10.0
""",
)
WINDY = Source(
    "windy.yaml",
    """\
agents:
    - {pid: 0, on_device: drone, position: [0, 0, 1]}
    - {pid: 1, on_device: drone, position: [1, 0, 1]}
devices:
    drone:
        bot_type: QUAD
        planner: RRT_DRONE
        simulation: {noise: {position: 0.05}, wind: {gust: 1.5}}
""",
)


def asked(program: Source, config: Source, seed: int = 0, **params: int) -> FitRequest:
    return fit_request(program, config, params, None, seed, None)


def runs_of(request: FitRequest, claim: str, time_s: float = 3.0) -> SplitRuns:
    target = target_of(request, fit(request), claim, None)
    return SplitRuns(Reseeding(request), target, None, time_s)


def test_a_branch_is_what_it_branched_off_up_to_there_and_new_from_there_on() -> None:
    runs = runs_of(asked(HOVERING, WINDY), "separation", 1.0)
    parent = runs.begun(5)
    assert len(parent.marks) > 2
    assert runs.begun(5) == parent
    middle = parent.marks[len(parent.marks) // 2]
    known = parent.marks[: parent.marks.index(middle) + 1]
    one, other = runs.branched(parent, middle, 1), runs.branched(parent, middle, 2)
    assert one.marks[: len(known)] == other.marks[: len(known)] == known
    assert len({parent.end, one.end, other.end}) == 3
    assert runs.branched(parent, middle, 1) == one
    later = next(mark for mark in one.marks if mark.looks > middle.looks)
    again = runs.branched(one, later, 3)
    assert again.marks[: one.marks.index(later) + 1] == one.marks[: one.marks.index(later) + 1]
    assert (runs.branches, runs.equal) == (4, 0)


def test_a_run_that_is_not_repeated_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = runs_of(asked(COIN, ONE), "Below")
    parent = next(run for run in map(runs.begun, range(9)) if len(run.marks) > 1)
    monkeypatch.setattr(splitting_runs, "_state", lambda made: b"another")
    with pytest.raises(KoordError) as told:
        runs.branched(parent, parent.marks[1], 1)
    assert [one.code for one in told.value.diagnostics] == ["K955"]


@pytest.mark.slow
def test_rates_of_a_program_are_the_known_ones() -> None:
    params = {"start": 1, "goal": 8}
    found = koord.splitting(
        COIN, ONE, claim="Below", params=params, particles=10, runs=8, duration_s=30
    )
    assert found.interval is not None
    assert found.interval.low <= 1 / 8 <= found.interval.high
    assert found.interval.high - found.interval.low < 0.2
    assert found.claim == "invariant Below"
    assert len({one.rate for one in found.repetitions}) > 5
    crude = koord.campaign(COIN, ONE, params=params, runs=50, duration_s=30)
    counted = rate(sum(row.is_bad for row in crude.runs), 50)
    assert counted.low <= found.interval.high
    assert found.interval.low <= counted.high
    assert not found.ok
    assert (
        koord.splitting(
            COIN, ONE, claim="Below", params=params, particles=10, runs=3, duration_s=30
        ).repetitions
        == found.repetitions[:3]
    )


def test_a_run_ends_where_it_breaks_the_claim() -> None:
    """What is higher after that counts for nothing, and what is broken stays the highest."""
    runs = runs_of(asked(COIN, ONE, start=2, goal=3), "Below", 100.0)
    made = [runs.begun(seed) for seed in range(20)]
    levels = {tuple(mark.level for mark in run.marks) for run in made}
    assert levels == {(-1.0,), (-1.0, math.inf)}


@pytest.mark.parametrize(
    ("claim", "level", "code", "words"),
    [
        ("Beneath", None, "K956", "no run of the program can break a claim 'Beneath'"),
        ("Odd", None, "K956", "nothing says how near a run is to breaking invariant Odd"),
        ("fault", None, "K956", "nothing says how near a run is to breaking fault"),
        ("Odd", "stopped", "K956", "this says nothing of how near a run is"),
        ("Odd", "y + 1", "K201", "`y` is not declared"),
    ],
)
def test_what_has_no_level_is_told(claim: str, level: str | None, code: str, words: str) -> None:
    with pytest.raises(KoordError) as told:
        koord.splitting(COIN, ONE, claim=claim, level=level, runs=2)
    (one,) = told.value.diagnostics
    assert one.code == code
    assert words in one.message
    if code == "K201":
        assert (one.span.file, one.span.line, one.span.column) == ("<level>", 1, 1)


def test_where_nothing_is_left_to_chance_it_is_told() -> None:
    calm = Source("calm.yaml", WINDY.text.replace("simulation: {noise", "#"))
    for particles, runs in ((4, 2), (60, 5)):
        with pytest.raises(KoordError) as told:
            koord.splitting(
                HOVERING, calm, claim="Near", particles=particles, runs=runs, duration_s=0.3
            )
        assert [one.code for one in told.value.diagnostics] == ["K955"]


def test_a_level_that_is_given_is_one_of_the_program() -> None:
    for level in ("x", "x >= 100 or x < 3", "Coin.side + x"):
        found = koord.splitting(
            COIN, ONE, claim="Odd", level=level, particles=4, runs=2, duration_s=2
        )
        assert found.interval is not None


# --- levels ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("claim", "level"),
    [
        ("x <= 5", -3.0),  # robots have 0, 1 and 2
        ("x < 5", -3.0),
        ("forall i: x@i >= 1", 1.0),
        ("exists i: x@i >= 1", -1.0),
        ("forall i: not (x@i >= 1)", 1.0),
        ("forall i: x@i == 1", 1.0),
        ("forall i: x@i != 5", -3.0),
        ("forall i: y@i <= 2", -1.5),
        ("forall i: x@i <= 5 and y@i <= 0.25", 0.25),
        ("forall i: x@i <= 5 or y@i <= 0.25", -3.0),
        ("forall i: on@i implies x@i <= 5", -4.0),
        ("forall i: not on@i or x@i <= 5", -4.0),
        ("forall i: not (on@i and x@i <= 5)", 4.0),
        ("forall i, j: i != j implies x@i - x@j <= 1", 1.0),
        ("forall i: not high(x@i, 1)", -2.0),
        ("forall i: on@i and x@i <= 5", math.inf),
    ],
)
def test_levels_say_by_how_much(claim: str, level: float) -> None:
    text = "def fun high(int k, int above) -> bool:\n    return k - above > 3\n"
    text += "local:\n    int x = 0\n    float y = 0.5\n    bool on = false\n"
    text += "init:\n    x = pid\n    on = pid == 1\n"
    text += f"Go:\n    eff: x = x\ninvariant It: {claim}\n"
    three = ONE.text.replace("]", ", {pid: 1, on_device: point}, {pid: 2, on_device: point}]")
    request = fit_request(Source("it.krd", text), Source("three.yaml", three), None, None, 0, None)
    assert level_in(request) == level


def level_in(request: FitRequest) -> float:
    """The level of the claim *It* at the start of a run."""
    from koord.api.sim_setup import simulation

    fitted = fit(request)
    target: Target = target_of(request, fitted, "It", None)
    assert target.code is not None
    made = simulation(fitted, Simulation, keep_going=True)
    made.begin()
    return ClaimGauge(target.code, made)(made)


# --- chance that is drawn anew --------------------------------------------------------------------


def test_nothing_drawn_ahead_outlives_new_seeds() -> None:
    import numpy as np

    old, new = ([np.random.SeedSequence((k, row)) for row in range(3)] for k in (1, 2))
    normals = Normals(old, 2)
    first = normals.draw()
    normals.reseed(new)
    assert (normals.draw() == Normals(new, 2).draw()).all()
    assert (first == Normals(old, 2).draw()).all()
    still = np.zeros((3, 3)), np.zeros(3)
    fixes = Fixes(Positioning(noise_m=0.1), old, flat=False)
    fixes.reseed(new)
    fresh = Fixes(Positioning(noise_m=0.1), new, flat=False)
    assert (fixes.read(*still, 0.1)[0] == fresh.read(*still, 0.1)[0]).all()
    gusts, others = Gusts(Wind(gust_mps=1.0), old), Gusts(Wind(gust_mps=1.0), new)
    gusts.reseed(new)
    assert (gusts.blow(0.1) == others.blow(0.1)).all()
