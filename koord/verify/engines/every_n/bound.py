"""The variables that inferred lemmas are about. [T-EVERY-N]"""

from __future__ import annotations

from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import INT

#: Two robots, an index of a fixed array, a robot that there is, and a third robot.
I = core.Variable(Home.BOUND, 0, "i", INT)  # noqa: E741 - as properties call it
J = core.Variable(Home.BOUND, 1, "j", INT)
K = core.Variable(Home.BOUND, 2, "k", INT)
M = core.Variable(Home.BOUND, 3, "m", INT)
H = core.Variable(Home.BOUND, 4, "h", INT)

READ_I, READ_J, READ_K, READ_H = (core.Read(core.Place(v)) for v in (I, J, K, H))

#: Slots from here on are free for what quantifiers inside of literals are about.
FREE_SLOT = 5
