"""Adaptive multilevel splitting: the probability of what happens in few runs, without bias.

``particles`` runs are made by chance, each as far as it goes. Those whose highest level is the
least of all are given up, all that are equal among them, and each is replaced by one of the others:
repeated up to where it first came above that level, and by new chance from there on. So it goes on
until each run breaks the claim, or all are equally far from it. Of ``n`` particles ``k`` were given
up each time, so the product of all ``1 − k/n`` estimates the probability that a run breaks the
claim, and its mean is that probability: whatever the level, the number of particles, and the ties.
(Cérou and Guyader 2007; Bréhier, Gazeau, Goudenège, Lelièvre, Rousset 2016, theorem 4.1)

For that, what is to come after a mark of a run has to hang on new chance alone, given what there is
at the mark, and a level counts when its round is over, not before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from random import Random
from typing import Any, Protocol, TypeVar

import numpy as np
from msgspec import Struct

from koord.api.campaign_figures import Interval, mean_and_reach, rate

#: What is less probable is not sought any further: it counts as never.
LEAST = 1e-12


class Mark(Protocol):
    """Where a run came above all levels that it had before."""

    @property
    def level(self) -> float: ...


M_co = TypeVar("M_co", bound=Mark, covariant=True)


class Particle(Protocol[M_co]):
    """A run as far as it goes."""

    @property
    def marks(self) -> Sequence[M_co]:
        """Where it came ever higher, its beginning first; the last is ∞ if it breaks the claim."""
        ...


M = TypeVar("M", bound=Mark)
M_contra = TypeVar("M_contra", bound=Mark, contravariant=True)
P = TypeVar("P", bound=Particle[Any])


class Splittable(Protocol[P, M_contra]):
    """What makes runs."""

    def begun(self, seed: int) -> P:
        """A run by chance."""
        ...

    def branched(self, particle: P, mark: M_contra, seed: int) -> P:
        """A run that is as another up to a mark of it, and goes on by chance."""
        ...


class Repetition(Struct, frozen=True):
    """What one repetition found."""

    rate: float  #: of runs that break the claim: an estimate whose mean is the probability
    broken_at_first: int  #: of its particles, before any was replaced
    runs: int  #: that were made, also in part
    steps: int  #: how often particles were replaced
    highest: float  #: of a run that broke nothing; −∞ if there is none
    is_cut: bool = False  #: whether less than LEAST was left


def seeds(seed: int, repetition: int) -> Iterator[int]:
    """Yield seeds of which none comes twice, here or in another repetition."""
    number = 0
    while True:
        source = np.random.SeedSequence((seed, repetition, number))
        yield int(source.generate_state(1, np.uint64)[0])
        number += 1


def split(runs: Splittable[P, M], particles: int, seed: int, repetition: int) -> Repetition:
    """Make one repetition, with two particles or more."""
    fresh, draw = seeds(seed, repetition), Random(f"{seed} {repetition}")
    living = [runs.begun(next(fresh)) for _ in range(particles)]
    broken_at_first = sum(_highest(one) == math.inf for one in living)
    share, made, steps, highest = 1.0, particles, 0, -math.inf
    while True:
        level = min(map(_highest, living))
        if level == math.inf:
            return Repetition(share, broken_at_first, made, steps, highest)
        highest = max(highest, *(of for one in living if (of := _highest(one)) < math.inf))
        above = [one for one in living if _highest(one) > level]
        fallen = particles - len(above)
        if not above:
            return Repetition(0.0, broken_at_first, made, steps, highest)
        share *= 1 - fallen / particles
        if share < LEAST:
            return Repetition(0.0, broken_at_first, made, steps, highest, is_cut=True)
        living = [*above]
        for parent in draw.choices(above, k=fallen):
            mark = next(mark for mark in parent.marks if mark.level > level)
            living.append(runs.branched(parent, mark, next(fresh)))
        made, steps = made + fallen, steps + 1


def _highest(particle: Particle[Any]) -> float:
    return float(particle.marks[-1].level)


def estimate(repetitions: Sequence[Repetition], particles: int) -> Interval:
    """The rate and its interval of 95 %, from independent repetitions.

    It is Student's, as of any mean: nearly right for twenty repetitions and more, most of which
    find something. Where all found the same (nothing, mostly) it says nothing, and only the first
    particles of each count, which are runs by chance. (Clopper and Pearson 1934)
    """
    rates = [one.rate for one in repetitions]
    mean, reach = mean_and_reach(rates)
    if not reach > 0:  # or it is none
        broken = sum(one.broken_at_first for one in repetitions)
        plain = rate(broken, particles * len(repetitions))
        return Interval(mean, min(mean, plain.low), max(mean, plain.high))
    slack = LEAST if any(one.is_cut for one in repetitions) else 0.0
    return Interval(mean, max(0.0, mean - reach), min(1.0, mean + reach + slack))
