"""Z3 is loaded without what is seldom needed; whoever asks for that has it."""

from __future__ import annotations

import subprocess
import sys


def said(program: str) -> list[str]:
    """What a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{program}"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stderr == ""
    return done.stdout.split("\n")[:-1]


LOADED = "from koord.verify.encoding.z3_loading import z3\n"


def test_functions_are_declared_when_they_are_called() -> None:
    found = said(
        f"{LOADED}"
        "before = z3.Z3_mk_solver.__defaults__[-1].f\n"
        "x, solver = z3.Int('x'), z3.Solver()\n"
        "solver.add(x > 3, x < 5)\n"
        "print(solver.check(), solver.model()[x])\n"
        "after = z3.Z3_mk_solver.__defaults__[-1].f\n"
        "print(type(before).__name__, type(after).__name__, after.restype is z3.SolverObj)\n"
        "print(type(z3.Z3_mk_fpa_abs.__defaults__[-1].f).__name__)"
    )
    assert found == ["sat 4", "_Function _FuncPtr True", "_Function"]


def test_errors_are_those_of_z3() -> None:
    found = said(
        f"{LOADED}"
        "try:\n"
        "    z3.parse_smt2_string('(assert')\n"
        "except z3.Z3Exception as error:\n"
        "    print('error' in str(error))\n"
        "try:\n"
        "    z3.Z3_mk_numeral(1)\n"
        "except TypeError as error:\n"
        "    print('missing' in str(error))"
    )
    assert found == ["True", "True"]


def test_seldom_needed_modules_are_there() -> None:
    found = said(
        f"{LOADED}"
        "x, y = z3.Ints('x y')\n"
        "print('z3.z3util' in sys.modules, hasattr(sys.modules['z3.z3util'], '__file__'))\n"
        "print(sorted(map(str, z3.z3util.get_vars(x + y))))\n"
        "from z3.z3num import Numeral\n"
        "print(Numeral(2) + 3)"
    )
    assert found == ["True False", "['x', 'y']", "5"]


def test_a_z3_that_is_there_is_left_as_it_is() -> None:
    found = said(
        "import z3 as theirs\n"
        f"{LOADED}"
        "from koord.verify.encoding.z3_builder import TermBuilder\n"
        "print(theirs is z3, type(z3.Z3_mk_solver.__defaults__[-1].f).__name__)\n"
        "made = TermBuilder(z3.Context())\n"
        "print(made.numeral(3, real=False))"
    )
    assert found == ["True _FuncPtr", "3"]
