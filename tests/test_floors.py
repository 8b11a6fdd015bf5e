"""The floors of ARCHITECTURE.md: imports go down only, and some things happen on one floor only.

The checker reads the syntax tree of every file, so that an import inside a function, under
``TYPE_CHECKING`` or by ``import_module("…")`` counts like any other.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from subprocess import run

import pytest

ROOT = Path(__file__).resolve().parent.parent

#: What each floor may import of koord, itself included. The command line has rules of its own.
ALLOWED = {
    "koord": (
        "koord.api",
        "koord.plugins.notebook",
        "koord.syntax.diagnostics",
        "koord.syntax.source",
    ),
    # The use-cases, of which everything below is a part.
    "api": (
        "koord.api",
        "koord.refinement",
        "koord.testing",
        "koord.sim",
        "koord.runtime",
        "koord.recheck",
        "koord.verify",
        "koord.kernels",
        "koord.machine",
        "koord.stores",
        "koord.sampling",
        "koord.traces",
        "koord.semantics",
        "koord.syntax",
    ),
    "lsp": ("koord.lsp", "koord.api"),
    "stores": ("koord.stores",),
    "machine": ("koord.machine", "koord.stores"),
    "syntax": ("koord.syntax",),
    "semantics": ("koord.semantics", "koord.syntax"),
    "traces": ("koord.traces", "koord.semantics", "koord.syntax"),
    "sampling": ("koord.sampling", "koord.traces", "koord.semantics", "koord.syntax"),
    "kernels": (
        "koord.kernels",
        "koord.machine",
        "koord.traces",
        "koord.semantics",
        "koord.syntax",
    ),
    "verify": (
        "koord.verify",
        "koord.kernels",
        "koord.stores",
        "koord.sampling",
        "koord.traces",
        "koord.semantics",
        "koord.syntax",
    ),
    # What other tools load shows verdicts as the command line does.
    "plugins": (
        "koord.plugins",
        "koord.cli",
        "koord.api",
        "koord.syntax.diagnostics",
        "koord.syntax.source",
        "koord.syntax.system",
    ),
    # What is checked twice has to be thought of twice: neither the evaluator nor the encoding.
    "recheck": ("koord.recheck", "koord.syntax"),
    "runtime": ("koord.runtime", "koord.machine", "koord.syntax"),
    # The judge of what runs knows both sides: the reference and the runtime.
    "refinement": (
        "koord.refinement",
        "koord.runtime",
        "koord.sampling",
        "koord.traces",
        "koord.semantics",
        "koord.syntax",
    ),
    "sim": ("koord.sim", "koord.runtime", "koord.machine", "koord.syntax"),
    # The other side of a wire shares nothing with the driver on this one.
    "testing": ("koord.testing",),
    # What tests drivers knows them, and other sides as processes alone.
    "testing.conformance": ("koord.testing.conformance", "koord.runtime"),
}

#: What a floor may not import of what it may: no analysis is relied on twice.
DENIED = {"recheck": ("koord.syntax.analysis",)}

#: What commands use besides the API: the plain data that it takes and answers.
PLAIN = (
    "koord.syntax.diagnostics",
    "koord.syntax.source",
    "koord.syntax.problem",
    "koord.syntax.literals",
    "koord.syntax.content",
    "koord.syntax.lazy_modules",  # and how other packages are loaded
    "koord.syntax.catalogue.Story",
    "koord.syntax.analysis.premises.Premise",
    "koord.syntax.analysis.premises.PremiseKind",
    "koord.syntax.core.LEAST_DELTA_S",
    "koord.syntax.core.MOST_DELTA_S",
    "koord.syntax.core.MOST_ROBOTS",
    "koord.syntax.core.USUAL_ROBOTS",
    "koord.syntax.core.PropertyKind",
    "koord.syntax.system.System",
    "koord.semantics.configurations.Configuration",
    "koord.semantics.configurations.NO_EVENT",
    "koord.semantics.configurations.Written",
    "koord.semantics.domain.Constant",
    "koord.semantics.recordings.Recording",
    "koord.semantics.recordings.Step",
    "koord.semantics.rounds.IllegalStepError",
    "koord.semantics.storage.Storage",
    "koord.sampling.policies.TakenStep",
    "koord.traces.changes.Change",
    "koord.traces.names",
    "koord.traces.replay.Refused",
    "koord.traces.trace",
    "koord.verify.claims.ClaimKind",
    "koord.verify.engine_names",
    "koord.verify.obstacles.Failure",
    "koord.verify.proof_core.ProofCore",
    "koord.verify.verdicts",
    "koord.recheck.checking.RecheckOutcome",
    "koord.recheck.checking.CheckedPart",
    "koord.recheck.checking.Rechecked",
    "koord.recheck.solving.SolverAnswer",
    "koord.recheck.claims.ClaimKind",
    "koord.recheck.meaning",
    "koord.recheck.premises",
    "koord.refinement.compiled_replay.Rerun",
    "koord.refinement.rounding.Unjudged",
    # How such data is written.
    "koord.traces.changes.changes",
    "koord.traces.fairness.told",
    "koord.traces.json_reader.shortened",
    "koord.traces.rendering",
)

#: What verification is about and what it answers, below all ways to find it out.
_ANSWERS = tuple(
    f"koord.verify.{name}"
    for name in (
        "claims",
        "each_claim",
        "effort",
        "engine_names",
        "failures",
        "forked",
        "helpers",
        "job_process",
        "ledger",
        "obstacles",
        "processes",
        "verdicts",
    )
)
_ENCODING = (*_ANSWERS, "koord.verify.encoding")

#: What engines share: whose responses to look at; from a model of the encoding to a run that was
#: replayed.
_WITNESSES = tuple(
    f"koord.verify.{name}"
    for name in ("bounded_check", "different_responses", "lasso_witness", "promises", "witness")
)
_BELOW_ENGINES = (*_ENCODING, *_WITNESSES)
_REDUCTION = (*_BELOW_ENGINES, "koord.verify.reduction", "koord.verify.reachability_goals")
_ENGINES = (*_REDUCTION, "koord.verify.engines")
_EVERYTHING = (*_ENGINES, "koord.verify.vacuity", "koord.verify")

#: What every room of the syntax stands on.
_PROGRAMS = tuple(
    f"koord.syntax.{path.stem}"
    for path in (ROOT / "koord/syntax").glob("*.py")
    if path.stem not in ("__init__", "load")
)
_PARSING = (*_PROGRAMS, "koord.syntax.parsing")

#: The floors within a room: what the modules of a prefix (the longest that fits) may import of the
#: room besides each other. No engine imports another one.
WITHIN = {
    **dict.fromkeys((*_PROGRAMS, "koord.syntax.analysis", "koord.syntax.catalogue"), _PROGRAMS),
    "koord.syntax.parsing": _PROGRAMS,
    "koord.syntax.printing": _PARSING,
    "koord.syntax.elaboration": (*_PARSING, "koord.syntax.analysis"),
    "koord.syntax.editing": (*_PARSING, "koord.syntax.elaboration", "koord.syntax.load"),
    **dict.fromkeys(_ANSWERS, _ANSWERS),
    "koord.verify.encoding": _ENCODING,
    **dict.fromkeys(_WITNESSES, _BELOW_ENGINES),
    "koord.verify.engines": _BELOW_ENGINES,
    **{
        f"koord.verify.engines.{path.name}": (*_BELOW_ENGINES, "koord.verify.engines.engine")
        for path in (ROOT / "koord/verify/engines").iterdir()
        if path.is_dir() and path.name != "__pycache__"
    },
    "koord.verify.reachability_goals": _ANSWERS,
    "koord.verify.reduction": _REDUCTION,
    "koord.verify.vacuity": _ENGINES,
    "koord.verify.export": (*_REDUCTION, "koord.verify.engines.bits"),
    "koord.verify.certificate_form": (),
    **dict.fromkeys(
        ("koord.verify.certified_progress", "koord.verify.certificates"),
        (*_ENGINES, "koord.verify.certificate_form", "koord.verify.certified_progress"),
    ),
    "koord.verify": _EVERYTHING,
}

#: Imports between floors of a room that are still to be cut. The list only gets shorter.
UNCUT: frozenset[tuple[str, str]] = frozenset()

#: Circles of imports between files that are still to be cut, each by its first file.
CIRCLES: set[str] = set()

#: Libraries that stand behind few files: (library, prefixes of the files, at most so many).
GUARDED = (
    (
        "z3",
        ("koord/verify/", "koord/refinement/protocol_proof/", "koord/refinement/guardian_proof/"),
        6,
    ),
    ("lark", ("koord/syntax/parsing/",), 1),
    ("cvc5", ("koord/recheck/",), 1),
    ("ompl", ("koord/runtime/motion/",), 1),
    ("shapely", ("koord/runtime/motion/",), 1),
    ("pymunk", ("koord/sim/",), 1),
    ("llvmlite", ("koord/machine/",), 2),
    ("mujoco", ("koord/sim/",), 1),
    ("mcap", ("koord/runtime/",), 1),
    ("cyclonedds", ("koord/runtime/drivers/ros2/", "koord/testing/ros2/"), 4),
    ("natnet", ("koord/runtime/drivers/localisers/",), 1),
    ("rerun", ("koord/sim/files/",), 1),
    ("rosbags", ("koord/sim/files/",), 1),
    ("viser", ("koord/sim/files/",), 1),
    ("pygls", ("koord/lsp/",), 1),
    ("pygments", ("koord/api/",), 1),
    ("mavsdk", ("koord/testing/autopilot/",), 1),
    ("asyncssh", ("koord/runtime/remote/",), 2),
    ("cflib", ("koord/runtime/drivers/crazyflie/",), 1),
    ("pymavlink", ("koord/runtime/drivers/mavlink/", "koord/testing/autopilot/"), 3),
)

#: The kernel, and the judge of all runs.
JUDGING = ("koord/semantics/", "koord/traces/")

#: Where printing, reading ``argv`` and exiting belong.
TALKING = (
    *("koord/cli/", "koord/__main__.py"),
    # Processes of their own, which tell others by their standard output.
    "koord/api/courier.py",
    "koord/runtime/drivers/localisers/motioncapture_reader.py",
    "koord/testing/conformance/killed.py",
    "koord/testing/conformance/lane.py",
    "koord/testing/cars.py",
    "koord/testing/truth.py",
    "koord/verify/answering.py",
    # Where processes of their own end at once, without freeing what they have.
    "koord/api/campaign_workers.py",
    "koord/runtime/motion/workers.py",
    "koord/sim/group_work.py",
)

TALKING_NAMES = frozenset({"print", "input", "exit", "quit", "SystemExit", "breakpoint"})
TALKING_ATTRIBUTES = frozenset(
    {"sys.argv", "sys.exit", "sys.stdout", "sys.stderr", "sys.stdin", "os._exit"}
)


@dataclass(frozen=True, slots=True)
class File:
    """A Python file: its path from the root, with slashes, and its text."""

    path: str
    text: str

    @property
    def module(self) -> str:
        return self.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


@dataclass(frozen=True, slots=True)
class Import:
    line: int
    module: str


@cache
def walked(file: File) -> tuple[ast.AST, ...]:
    """What a file is made of, of what is asked about here."""
    wanted = (ast.Import, ast.ImportFrom, ast.Call, ast.Name, ast.Attribute)
    nodes = ast.walk(ast.parse(file.text, file.path))
    return tuple(node for node in nodes if isinstance(node, wanted))


@cache
def imports(file: File) -> tuple[Import, ...]:
    return tuple(_imports(file))


def _imports(file: File) -> Iterator[Import]:
    """Every module a file names in an import; ``from a import b`` names ``a`` and ``a.b``."""
    package = file.module.split(".")
    if not file.path.endswith("__init__.py"):
        package.pop()
    for node in walked(file):
        match node:
            case ast.Import(names=names):
                for alias in names:
                    yield Import(node.lineno, alias.name)
            case ast.ImportFrom(module=module, names=names, level=level):
                base = package[: len(package) - level + 1] if level else []
                origin = ".".join([*base, *([module] if module else [])])
                for alias in names:
                    yield Import(node.lineno, f"{origin}.{alias.name}")
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__")
                | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                yield Import(node.lineno, name)
            case _:
                pass


def within(module: str, prefixes: Iterable[str]) -> bool:
    return any(module == prefix or module.startswith(f"{prefix}.") for prefix in prefixes)


def upward_imports(file: File) -> Iterator[str]:
    """Imports of koord that a file's floor does not allow."""
    rooms = file.module.split(".")[1:]
    floor = next(
        (name for k in (2, 1) if (name := ".".join(rooms[:k])) in (*ALLOWED, "cli")), "koord"
    )
    if floor == "cli" or file.path == "koord/__main__.py":
        return
    allowed = ALLOWED.get(floor, ())
    for found in imports(file):
        # `from koord import syntax` names koord.syntax.
        if found.module == "koord" or not within(found.module, ("koord",)):
            continue
        denied = within(found.module, DENIED.get(floor, ()))
        if within(found.module, ("koord.version", *allowed)) and not denied:
            continue
        yield f"{file.path}:{found.line}: {floor} must not import {found.module}"


def imports_across(file: File) -> Iterator[tuple[str, str]]:
    """Imports that the floors within a room do not allow: who imports, and what."""
    fitting = [prefix for prefix in WITHIN if within(file.module, (prefix,))]
    if not fitting:
        return
    own = max(fitting, key=len)
    room = ".".join(own.split(".")[:2])
    for found in imports(file):
        if within(found.module, (room,)) and not within(found.module, (own, *WITHIN[own])):
            yield file.module, found.module


def circles(files: Sequence[File]) -> list[list[str]]:
    """Files that import each other by some way: the strongly connected parts of more than one."""
    modules = {file.module for file in files}
    graph = {
        file.module: {
            next((name for name in names if name in modules), file.module)
            for found in imports(file)
            for names in [(found.module, found.module.rpartition(".")[0])]
        }
        - {file.module}
        for file in files
    }
    reached: dict[str, set[str]] = {}
    for module in graph:
        seen: set[str] = set()
        ahead = [module]
        while ahead:
            new = graph[ahead.pop()] - seen
            seen |= new
            ahead += new
        reached[module] = seen
    found = {
        tuple(sorted(other for other in reached[module] if module in reached[other]))
        for module in graph
        if module in reached[module]
    }
    return sorted(map(list, found))


def working(file: File) -> list[str]:
    """Imports by which a file of the command line does what the API is for."""
    allowed = ("koord.api", "koord.lsp", "koord.cli", "koord.version", *PLAIN)
    return [
        f"{file.path}:{found.line}: koord/cli must not import {found.module}"
        for found in imports(file)
        if within(found.module, ("koord",)) and not within(found.module, allowed)
    ]


def guarded_imports(files: Iterable[File]) -> Iterator[str]:
    """Imports of libraries outside of the few files that may know them."""
    imported = [(file.path, found) for file in files for found in imports(file)]
    for library, prefixes, most in GUARDED:
        users = {path: found.line for path, found in imported if within(found.module, (library,))}
        for path, line in users.items():
            if not path.startswith(prefixes):
                yield f"{path}:{line}: {library} must be imported in {' or '.join(prefixes)} only"
        if len(users) > most:
            yield f"{library} is imported in {len(users)} files, more than {most}: {sorted(users)}"


def talking(file: File) -> Iterator[str]:
    """Uses of standard streams, arguments and exits below the command line."""
    if file.path.startswith(TALKING):
        return
    for node in walked(file):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) if name in TALKING_NAMES:
                yield f"{file.path}:{node.lineno}: {name} belongs in koord/cli"
            case ast.Attribute(value=ast.Name(id=owner), attr=attribute):
                if f"{owner}.{attribute}" in TALKING_ATTRIBUTES:
                    yield f"{file.path}:{node.lineno}: {owner}.{attribute} belongs in koord/cli"
            case ast.ImportFrom(module="sys" | "os" as owner, names=names):
                for alias in names:
                    if f"{owner}.{alias.name}" in TALKING_ATTRIBUTES:
                        yield f"{file.path}:{node.lineno}: {alias.name} belongs in koord/cli"
            case _:
                pass


@cache
def package_files() -> list[File]:
    return [
        File(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "koord").rglob("*.py"))
    ]


# --- the project ----------------------------------------------------------------------------------


def test_imports_go_down_only() -> None:
    files = package_files()
    assert len(files) > 10
    assert [line for file in files for line in upward_imports(file)] == []


def test_imports_within_a_room_go_down_only() -> None:
    found = {pair for file in package_files() for pair in imports_across(file)}
    assert found == UNCUT, "the list gets shorter"


def test_no_files_import_each_other() -> None:
    found = circles(package_files())
    assert {circle[0] for circle in found} == CIRCLES, "the list gets shorter"


def test_the_command_line_uses_the_api_alone() -> None:
    commands = [file for file in package_files() if file.path.startswith("koord/cli/")]
    assert len(commands) > 10
    assert [line for file in commands for line in working(file)] == []


def test_libraries_stand_behind_their_files() -> None:
    assert list(guarded_imports(package_files())) == []


def test_only_the_command_line_talks() -> None:
    assert [line for file in package_files() for line in talking(file)] == []


def test_kernel_and_judge_import_no_engine_and_no_sampler() -> None:
    """Whoever judges a trace has loaded nothing that could have found it."""
    judging = [f.module for f in package_files() if f.path.startswith(JUDGING)]
    program = f"import sys, {', '.join(judging)}\nprint(*sys.modules)"
    ran = run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    rooms = {name.split(".")[1] for name in ran.stdout.split() if name.startswith("koord.")}
    assert rooms == {"semantics", "syntax", "traces"}
    assert "z3" not in ran.stdout.split()


def test_every_folder_is_on_a_floor() -> None:
    floors = {path.name for path in (ROOT / "koord").iterdir() if path.is_dir()}
    assert floors - {"__pycache__"} <= {*ALLOWED, "cli"}


# --- the checker, on files that break the rules ---------------------------------------------------


@pytest.mark.parametrize(
    ("path", "text", "blamed"),
    [
        ("koord/syntax/a.py", "import koord.semantics.values", "koord.semantics.values"),
        ("koord/syntax/a.py", "from koord import verify", "koord.verify"),
        ("koord/syntax/a.py", "from ..semantics import values", "koord.semantics.values"),
        ("koord/syntax/a.py", "from .. import cli", "koord.cli"),
        ("koord/syntax/__init__.py", "from ..cli import main", "koord.cli.main"),
        ("koord/semantics/a.py", "def f():\n    import koord.verify.z", "koord.verify.z"),
        ("koord/semantics/a.py", "if TYPE_CHECKING:\n    import koord.cli.main", "koord.cli.main"),
        ("koord/verify/a.py", "from koord.runtime.machine import M", "koord.runtime.machine.M"),
        ("koord/verify/a.py", "from importlib import import_module as i\nimport koord.sim", "sim"),
        ("koord/verify/a.py", 'import_module("koord.sim.world")', "koord.sim.world"),
        ("koord/verify/a.py", "from koord.recheck import terms", "koord.recheck"),
        ("koord/recheck/a.py", "from koord.semantics import values", "koord.semantics.values"),
        ("koord/recheck/a.py", "from koord.syntax.analysis import reads", "koord.syntax.analysis"),
        ("koord/recheck/a.py", "import koord.verify.encoding.terms", "koord.verify.encoding.terms"),
        ("koord/runtime/a.py", "from koord.verify import x", "koord.verify.x"),
        ("koord/runtime/a.py", "from koord.refinement import x", "koord.refinement.x"),
        ("koord/refinement/a.py", "from koord.verify import x", "koord.verify.x"),
        ("koord/runtime/a.py", "from koord.semantics.rounds import x", "koord.semantics.rounds"),
        ("koord/runtime/a.py", "from koord.semantics import rounds", "koord.semantics.rounds"),
        ("koord/semantics/a.py", "from koord.traces import trace", "koord.traces.trace"),
        ("koord/traces/a.py", "import koord.verify_of", "koord.verify_of"),
        ("koord/traces/a.py", "from koord.sampling import values", "koord.sampling.values"),
        ("koord/sim/a.py", "import koord.verify", "koord.verify"),
        ("koord/__init__.py", "from koord.syntax import core", "koord.syntax.core"),
        ("koord/api/a.py", "from koord.cli.main import main", "koord.cli.main"),
        ("koord/runtime/a.py", "import koord.api.programs", "koord.api.programs"),
    ],
)
def test_an_upward_import_is_found(path: str, text: str, blamed: str) -> None:
    found = list(upward_imports(File(path, text)))
    assert len(found) == 1
    assert blamed in found[0]
    assert found[0].startswith(path)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("koord/cli/a.py", "import koord.verify, koord.sim, koord.runtime"),
        ("koord/sim/a.py", "from koord.runtime import machine"),
        ("koord/verify/a.py", "from koord.traces.trace import Trace"),
        ("koord/traces/a.py", "from koord.semantics import values"),
        ("koord/refinement/a.py", "from koord.semantics import rounds\nimport koord.runtime.robot"),
        ("koord/verify/a.py", "from koord.semantics import rounds\nfrom . import b\nimport os"),
        ("koord/syntax/elaboration/a.py", "from ..core import Expr\nimport koord.version"),
    ],
)
def test_a_downward_import_is_allowed(path: str, text: str) -> None:
    assert list(upward_imports(File(path, text))) == []


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("koord/verify/engines/bits/a.py", "from koord.verify.engines.horn.b import c"),
        ("koord/verify/engines/bits/a.py", "from koord.verify import strategy"),
        ("koord/verify/encoding/a.py", "import koord.verify.engines.bits.graph"),
        ("koord/verify/ledger.py", "from koord.verify.encoding.solver import Solver"),
        ("koord/verify/reduction/a.py", "from koord.verify.vacuity.b import c"),
    ],
)
def test_an_import_across_floors_of_a_room_is_found(path: str, text: str) -> None:
    assert len(list(imports_across(File(path, text)))) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("koord/verify/engines/bits/a.py", "from koord.verify.engines.bits.b import c"),
        ("koord/verify/engines/bits/a.py", "from koord.verify.encoding import terms"),
        ("koord/verify/strategy/verification.py", "from koord.verify.engines.bits.b import c"),
        ("koord/verify/encoding/a.py", "from koord.verify.claims import Claim"),
        ("koord/syntax/a.py", "from koord.syntax.b import c"),
    ],
)
def test_an_import_down_a_room_is_allowed(path: str, text: str) -> None:
    assert list(imports_across(File(path, text))) == []


def test_a_circle_is_found() -> None:
    texts = {
        "a": "from koord.x import b",
        "b": "if TYPE_CHECKING:\n    from koord.x.c import thing",
        "c": "def f():\n    import koord.x.a\nimport koord.x.d",
        "d": "from koord.x.e import thing",
        "e": "import os",
    }
    files = [File(f"koord/x/{name}.py", text) for name, text in texts.items()]
    assert circles(files) == [["koord.x.a", "koord.x.b", "koord.x.c"]]
    assert circles(files[1:]) == []


def test_a_stray_library_is_found() -> None:
    stray = File("koord/semantics/a.py", "def f():\n    from z3 import Int")
    assert list(guarded_imports([stray])) == [
        "koord/semantics/a.py:2: z3 must be imported in koord/verify/ or "
        "koord/refinement/protocol_proof/ or koord/refinement/guardian_proof/ only"
    ]
    assert len(list(guarded_imports([File("koord/syntax/types.py", "import lark")]))) == 1
    assert (
        list(guarded_imports([File("koord/syntax/parsing/parser.py", "import lark.lexer")])) == []
    )
    many = [File(f"koord/verify/{letter}.py", "import z3") for letter in "abcdefg"]
    assert list(guarded_imports(many[:6])) == []
    assert "more than 6" in next(guarded_imports(many))


@pytest.mark.parametrize(
    "text",
    [
        "print(1)",
        "import sys\nx = sys.argv[1:]",
        "import sys\nsys.exit(2)",
        "from sys import argv",
        "import sys\nsys.stderr.write('')",
        "raise SystemExit",
        "f(print)",
        "import os\nos._exit(1)",
    ],
)
def test_talking_below_the_command_line_is_found(text: str) -> None:
    assert len(list(talking(File("koord/semantics/a.py", text)))) == 1
    assert list(talking(File("koord/cli/a.py", text))) == []


def test_names_that_merely_look_alike_are_no_talking() -> None:
    text = "import sys\nx = sys.maxsize\nself.print(x)\nreport.exit = 1\nprinted = 3"
    assert list(talking(File("koord/verify/a.py", text))) == []
