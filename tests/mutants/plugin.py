"""A pytest plugin that imports one module of koord with a mistake in it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from types import CodeType, ModuleType

from tests.mutants.catalogue import MUTANTS
from tests.mutants.mutant import VARIABLE, Mutant


class _Loader(SourceFileLoader):
    """Compiles the mutated tree, without looking at what was compiled before."""

    def __init__(self, mutant: Mutant) -> None:
        super().__init__(mutant.module, str(mutant.path))
        self._mutant = mutant

    def get_code(self, fullname: str) -> CodeType:
        code = compile(self._mutant.tree(), str(self._mutant.path), "exec", dont_inherit=True)
        assert isinstance(code, CodeType)
        return code


class _Finder(MetaPathFinder):
    """Finds the mutated module before anyone else does."""

    def __init__(self, mutant: Mutant) -> None:
        self._mutant = mutant

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._mutant.module:
            return None
        return spec_from_file_location(fullname, self._mutant.path, loader=_Loader(self._mutant))


def _install() -> None:
    name = os.environ.get(VARIABLE, "")
    if name:
        (mutant,) = [m for m in MUTANTS if m.name == name]
        assert mutant.module not in sys.modules
        sys.meta_path.insert(0, _Finder(mutant))


_install()
