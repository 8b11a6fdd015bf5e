"""Programs that differ in where they start, compiled once: as runs with tasks of their own do."""

from __future__ import annotations

from typing import Any

from koord.runtime.compile.formatting import formatted
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.program import ProgramModule
from koord.runtime.robot import Robot
from koord.syntax import core


class StartCompiler:
    """Compiles a program, and others that differ from it in initial values of allwrite variables.

    These have to be of the same types, as the places of as many tasks are.
    """

    def __init__(self, program: core.Program) -> None:
        self._program, self._module = program, ProgramModule(program)
        self._classes = loaded(formatted(self._module.lines()))

    def classes(self, program: core.Program) -> tuple[type[Robot], ...]:
        """The robot classes of a program, by the position of their kind."""
        if program.allwrite == self._program.allwrite:
            return self._classes
        text = "\n".join(self._module.declare(program.allwrite))
        made: dict[str, Any] = {}
        known = self._classes[0].declare.__globals__  # those of the compiled module
        exec(compile(text, "<koord_compiled>", "exec"), known, made)
        return tuple(type(one.__name__, (one,), dict(made)) for one in self._classes)
