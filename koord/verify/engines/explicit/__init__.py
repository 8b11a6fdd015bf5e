"""Explicit-state model checking, for programs whose inputs have finitely many values.

Read :mod:`koord.verify.engines.explicit.search` first. Configurations are tuples of numbers
(``canonical``); what one robot can do is worked out once for what it reads (``menus``) and combined
without trying orders (``joint``, ``commits``); of configurations that differ by a renaming of
robots or of values, one is kept (``symmetry``, ``sorting``, ``orbits``).
"""
