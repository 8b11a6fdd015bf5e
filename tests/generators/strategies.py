"""Hypothesis strategies: generated systems that shrink with the choices that made them."""

from __future__ import annotations

from hypothesis import strategies as st

from koord.refinement.generating.palette import GENERAL, Profile
from koord.refinement.generating.programs import system
from koord.syntax.system import System


def systems(profile: Profile = GENERAL) -> st.SearchStrategy[System]:
    """Systems of random programs."""
    return st.randoms(use_true_random=False).map(lambda random: system(random, profile))
