"""Build the playground: ``python -m playground [FOLDER]`` makes a static page, in build/playground.

Needs Node.js 20, and the registries of npm and PyPI the first time. What comes from there is
pinned, with hashes: ``package-lock.json``, ``wheels.txt``.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from koord.api.story_page import page_of
from koord.sim.page_files import filled
from koord.syntax import vocabulary
from koord.syntax.elaboration.library import library_names
from koord.version import __version__

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parent
EXAMPLES = ROOT / "specs" / "examples"

#: What of pyodide a browser loads.
PYODIDE = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm")

#: What browsers have Python for, as wheels name it: that of the pinned pyodide.
PYTHON, PLATFORM = "3.14", "pyemscripten_2026_0_wasm32"

#: Files of wheels that nobody loads there.
_NOT_LOADED = re.compile(
    r"\.(h|pyi)$|\.so\.[\d.]+$|\.(dist-info|data)/|/(examples|allies)/|^z3/include/"
)

#: Rooms of koord that the public API asks nothing of, as far as it is asked here.
_NOT_ASKED = re.compile(r"koord/(cli|lsp|plugins|testing|recheck|api/template)/")


class BuildError(Exception):
    """Raised where the playground cannot be built."""


class NotHereError(BuildError):
    """Raised where what is needed to build is not to be had: a program, or a registry."""


# --- what is asked of registries ------------------------------------------------------------------


def modules() -> Path:
    """The folder of pyodide, as ``package-lock.json`` says it. Raises BuildError."""
    found = FOLDER / "node_modules" / "pyodide"
    wanted = json.loads((FOLDER / "package-lock.json").read_text("utf-8"))["packages"]
    manifest = found / "package.json"
    version = wanted["node_modules/pyodide"]["version"]
    if not manifest.is_file() or json.loads(manifest.read_text("utf-8"))["version"] != version:
        flags = ("--no-fund", "--no-audit", "--ignore-scripts")
        _call(["npm", "ci", *flags], FOLDER, NotHereError)
    return found


def wheels(folder: Path) -> list[Path]:
    """The wheels of ``wheels.txt``, in a folder. Raises BuildError."""
    pinned = dict(_pinned())
    found = {path: _digest(path) for path in sorted(folder.glob("*.whl"))}
    if set(found.values()) != set(pinned):
        shutil.rmtree(folder, ignore_errors=True)
        abi = f"cp{PYTHON.replace('.', '')}"
        flags = ["--no-deps", "--require-hashes", "--only-binary", ":all:", "--quiet"]
        target = ["--platform", PLATFORM, "--python-version", PYTHON, "--implementation", "cp"]
        pip = [sys.executable, "-m", "pip", "download", "--dest", str(folder), *flags, *target]
        abis = ["--abi", abi, "--abi", "none"]
        _call([*pip, *abis, "--requirement", str(FOLDER / "wheels.txt")], ROOT, NotHereError)
        found = {path: _digest(path) for path in sorted(folder.glob("*.whl"))}
    return list(found)


def _pinned() -> Iterator[tuple[str, str]]:
    """The hashes of ``wheels.txt``, each with its package."""
    for line in (FOLDER / "wheels.txt").read_text("utf-8").splitlines():
        package = re.match(r"([\w.-]+)==\S+ --hash=sha256:([0-9a-f]{64})$", line)
        if package is not None:
            yield package[2], package[1]


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _call(command: list[str], folder: Path, failure: type[BuildError]) -> None:
    """Run a command. Raises NotHereError if it is not installed, and ``failure`` if it fails."""
    program = shutil.which(command[0])
    if program is None:
        raise NotHereError(f"{command[0]} is not installed; it comes with Node.js 20")
    done = subprocess.run(
        [program, *command[1:]], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr or done.stdout).strip()[-2000:]
        raise failure(f"{' '.join(command[:4])} ended with {done.returncode}\n{last}")


# --- Python for browsers --------------------------------------------------------------------------


def sources() -> Iterator[tuple[str, Path]]:
    """What of this tree browsers load, by the name that it has there."""
    kept = [path for path in (ROOT / "koord").rglob("*") if path.is_file()]
    for path in (*sorted(kept), FOLDER / "__init__.py", FOLDER / "answering.py"):
        name = path.relative_to(ROOT).as_posix()
        if "__pycache__" not in name and not _NOT_ASKED.match(name):
            yield name, path


def gather(made: Path, packed_wheels: Iterable[Path]) -> None:
    """Write an archive of all sources: those of wheels, and those of this tree."""
    with zipfile.ZipFile(made, "w") as archive:
        for wheel in packed_wheels:
            with zipfile.ZipFile(wheel) as packed:
                for name in packed.namelist():
                    if not _NOT_LOADED.search(name) and not name.endswith("/"):
                        archive.writestr(name, packed.read(name))
        for name, path in sources():
            archive.write(path, name)


# --- the page -------------------------------------------------------------------------------------


def examples() -> Iterator[dict[str, str]]:
    """The programs that can be chosen; some are in two groups."""
    for group, under, names in (
        ("To begin with", ".", ("task", "leader_elect")),
        ("To begin with", "broken", ("leader_elect_early", "task_no_lock")),
        ("Examples", ".", ()),
        ("With a mistake", "broken", ()),
        ("Protocols", "protocols", ()),
        ("Protocols with a mistake", "protocols/broken", ()),
        ("Systems of others", "systems", ()),
    ):
        folder = EXAMPLES / under
        for name in names or sorted(path.stem for path in folder.glob("*.krd")):
            text = (folder / f"{name}.krd").read_text("utf-8")
            yield {"group": group, "name": name, "text": text}


def words() -> dict[str, list[str]]:
    """The words of the language by what they are coloured as."""
    return {
        "section": sorted(vocabulary.SECTIONS | vocabulary.CONTEXTUAL),
        "statement": sorted(vocabulary.STATEMENTS),
        "operator": sorted(vocabulary.OPERATORS),
        "constant": sorted(vocabulary.CONSTANTS),
        "own": sorted(vocabulary.OWN_NAMES),
        "function": sorted(vocabulary.FUNCTIONS | set(library_names())),
        "type": sorted(vocabulary.TYPES | vocabulary.GENERIC_TYPES),
    }


def page() -> str:
    """The page, complete but for its worker."""
    data = {"words": words(), "examples": list(examples()), "version": __version__}
    told = json.dumps(data, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
    made = filled("playground", "koord playground", ("dom", "editor", "links", "main"), told)
    # A page within a page may do what both allow, so that the script of stories is named here.
    scripts = (_script(made), _script(page_of("", [])))
    hashes = " ".join(f"'sha256-{_base64(script)}'" for script in scripts)
    policy = (
        f"default-src 'none'; script-src 'self' {hashes}; style-src 'unsafe-inline'; "
        "worker-src 'self'; connect-src 'self'; img-src data:; frame-src 'self'; "
        "base-uri 'none'; form-action 'none'"
    )
    return made.replace("POLICY", policy, 1)


def _script(page: str) -> str:
    """The one script of a page that is run."""
    found = re.search(r"<script>(.*)</script>", page, re.DOTALL)
    assert found is not None, "a page of koord has one"
    return found[1]


def _base64(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def build(folder: Path) -> None:
    """Build the playground in a folder. Raises BuildError."""
    pyodide = modules()
    (folder / "pyodide").mkdir(parents=True, exist_ok=True)
    for name in PYODIDE:
        shutil.copyfile(pyodide / name, folder / "pyodide" / name)
    with tempfile.TemporaryDirectory() as name:
        gathered = Path(name) / "packages.zip"
        gather(gathered, wheels(ROOT / "build" / "playground-wheels"))
        parts = [str(path) for path in (pyodide / "python_stdlib.zip", gathered, folder)]
        _call(["node", str(FOLDER / "compile.mjs"), *parts], FOLDER, BuildError)
    # The packages that pyodide knows are elsewhere, where nobody is to ask for them.
    known = json.loads((pyodide / "pyodide-lock.json").read_text("utf-8"))
    lock = json.dumps({**known, "packages": {}})
    (folder / "pyodide" / "pyodide-lock.json").write_text(lock, "utf-8")
    shutil.copyfile(FOLDER / "page" / "worker.js", folder / "worker.js")
    (folder / "index.html").write_text(page(), "utf-8")


def main(arguments: list[str]) -> int:
    """Build it, and say how it is looked at."""
    folder = Path(arguments[0]) if arguments else ROOT / "build" / "playground"
    try:
        build(folder)
    except BuildError as error:
        print(f"playground: {error}", file=sys.stderr)
        return 1
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{folder}: {size / 1e6:.1f} MB; to look at it: python -m http.server -d {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
