"""Programs whose runs without end are looked at, by tests of lassos, engines and commands."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax.system import System, dealt
from tests.loading import program_of

#: A robot that is in asks to get out, and others wait meanwhile, so that their events come and go.
GATE = """
    local:
      bool inside = false
    allwrite:
      int holder = -1
    Enter:
      pre: holder == -1
      eff:
        atomic:
          holder = pid
          inside = true
    Leave:
      pre: inside
      eff:
        atomic:
          holder = -1
          inside = false
"""

SERVED = "    eventually Served: true leadsto inside\n"

#: A robot may stop before it has done what it is to do.
QUITTING = """
    local:
      bool done = false
    Quit:
      eff: stop
    Do:
      pre: not done
      eff: done = true
    eventually Done: done
"""

#: Each robot passes 2 on its way round, but not all need be there at once.
PASSING = """
    local:
      int n = 0
    Up:
      eff: n = (n + 1) % 3
"""

#: What each robot does by itself leads to nothing that it does itself.
TWO = """
    local:
      int n = 0
    First:
      pre: pid == 0 and n == 0
      eff: n = 1
    Second:
      pre: pid == 1 and n == 0
      eff: n = 2
    eventually Each: n == 1 leadsto n == 2
"""


def system(text: str, robots: int = 2) -> System:
    """The system of an indented text without mistakes, with a second a round."""
    return dealt(program_of(text), robots, Fraction(1))
