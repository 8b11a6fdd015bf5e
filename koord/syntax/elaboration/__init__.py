"""Elaboration: from the tree of a file to the typed core program.

Read :mod:`koord.syntax.elaboration.program` first, which names the steps in their order. A
``BodyScope`` (``body.py``) is the place where an expression or a statement stands; every function
that elaborates one takes it first. An answer of None means that something is wrong and told
already: nobody tells it again.
"""

from __future__ import annotations

from koord.syntax.elaboration.program import elaborate
from koord.syntax.elaboration.settings import Elaborated, ParamValue, Settings

__all__ = ["Elaborated", "ParamValue", "Settings", "elaborate"]
