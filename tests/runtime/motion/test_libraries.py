"""Heavy libraries: loaded when they are used, and missed politely."""

from __future__ import annotations

import subprocess
import sys

import pytest

from koord.runtime.motion.libraries import require
from koord.syntax.diagnostics import KoordError

HEAVY = ("ompl", "osqp", "pymunk", "shapely", "llvmlite", "scipy", "numpy")


def loaded_after(statement: str) -> set[str]:
    program = f"import sys\n{statement}\nprint(' '.join(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    return set(done.stdout.split()) & set(HEAVY)


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("import koord.runtime.motion, koord.sim, koord.runtime", set()),
        ("import koord.runtime.motion.world, koord.runtime.motion.bodies", set()),
        ("import koord.runtime.motion.automaton", {"numpy"}),
        ("import koord.sim.vehicles.quadrotors", {"numpy"}),
        # Planners, footprints, and rounds of drones: where nothing is in the way no more is needed.
        ("import koord.runtime.motion.rrt, koord.runtime.motion.shapes", {"numpy"}),
        ("import koord.sim.running, koord.sim.strides", {"numpy", "llvmlite"}),
    ],
)
def test_a_library_is_loaded_only_where_it_is_used(statement: str, expected: set[str]) -> None:
    assert loaded_after(statement) == expected


@pytest.mark.parametrize(
    ("library", "module"),
    [
        ("ompl", "koord.runtime.motion.rrt"),
        ("shapely", "koord.runtime.motion.shapes"),
        ("pymunk", "koord.sim.vehicles.contact"),
        ("llvmlite", "koord.sim.vehicles.compiled"),
    ],
)
def test_a_missing_library_is_named_with_its_cure(library: str, module: str) -> None:
    program = (
        "import sys, importlib\n"
        f"sys.modules[{library!r}] = None\n"
        "from koord.syntax.diagnostics import KoordError\n"
        "try:\n"
        f"    importlib.import_module({module!r})\n"
        "except KoordError as error:\n"
        "    found = error.diagnostics[0]\n"
        "    print(found.code, found.message, found.hint)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.startswith(f"K950 {library} is needed")
    assert "pip install 'koord[" in done.stdout


def test_what_is_missing_is_found_before_a_run() -> None:
    require(("numpy", "shapely"), "sim")
    with pytest.raises(KoordError, match="nonesuch") as caught:
        require(("numpy", "nonesuch"), "sim")
    assert caught.value.diagnostics[0].hint == "install it with: pip install 'koord[sim]'"
