"""What the benchmarks share: measured child processes, tables with limits, results as JSON.

A benchmark is a function from a :class:`Report` to nothing, which measures and adds tables;
:func:`main` does the rest. Times are those of child processes, with their start-up: *wall* is what
a user waits, *CPU* is user and system time of the child and its children, and *memory* is the most
that was resident. On a busy machine CPU time is the one to look at, and still an upper bound.

A benchmark fails (exit code 1) if an answer is wrong, never because something took long.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

ROOT = Path(__file__).resolve().parent.parent
BENCHMARKS = ROOT / "benchmarks"
RESULTS = BENCHMARKS / "results"
EXAMPLES = ROOT / "specs" / "examples"

#: The libraries whose versions belong to a result.
PACKAGES = ("koord", "lark", "z3-solver", "numpy")

#: What stands in a table where there is nothing to say.
NOTHING = "–"

Cell: TypeAlias = str | int | float | bool | None
Row: TypeAlias = Mapping[str, Cell]


# --- child processes ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Measured:
    """One run of a child process. ``code`` is negative if a signal ended it."""

    code: int
    wall_s: float
    cpu_s: float
    peak_mib: float
    output: str
    errors: str
    timed_out: bool

    def json(self) -> Any:
        """What it printed, as JSON; None if that is none."""
        try:
            return json.loads(self.output)
        except ValueError:
            return None

    def report(self) -> Any:
        """What ``koord verify --json`` says of its one program; None if it was stopped."""
        found = self.json()
        return None if found is None or "reports" not in found else found["reports"][0]


def measure(
    command: Sequence[str],
    *,
    timeout_s: float = 120.0,
    stdin: bytes | None = None,
    folder: Path = ROOT,
) -> Measured:
    """Run a command in a folder to its end, or for so long, and measure it.

    The kernel counts the memory of the process that forks as the child's until it has become
    another program, so nothing below the size of this process can be seen: it must stay small.
    """
    with (
        tempfile.TemporaryFile() as given,
        tempfile.TemporaryFile() as output,
        tempfile.TemporaryFile() as errors,
    ):
        given.write(stdin or b"")
        given.seek(0)
        begun = time.perf_counter()
        child = subprocess.Popen(
            list(command),
            stdin=given,
            stdout=output,
            stderr=errors,
            cwd=folder,
            env=_environment(),
            start_new_session=True,
        )
        alarm = _Alarm(child.pid, timeout_s)
        try:
            _, status, usage = os.wait4(child.pid, 0)
        except BaseException:
            alarm.ring()
            raise
        finally:
            alarm.cancel()
        wall_s = time.perf_counter() - begun
        child.returncode = os.waitstatus_to_exitcode(status)  # or Popen would wait for it, too
        return Measured(
            child.returncode,
            wall_s,
            usage.ru_utime + usage.ru_stime,
            _mib(usage),
            _text(output),
            _text(errors),
            alarm.rung,
        )


def koord(*arguments: str, timeout_s: float = 120.0, stdin: bytes | None = None) -> Measured:
    """Measure a command of koord."""
    return measure([sys.executable, "-m", "koord", *arguments], timeout_s=timeout_s, stdin=stdin)


def in_child(function: Callable[..., object], *arguments: Cell, timeout_s: float = 120.0) -> Any:
    """What a function of a benchmark returns in a fresh interpreter, through JSON.

    Raises RuntimeError if it did not return.
    """
    module = Path(function.__code__.co_filename).stem
    program = (
        f"import json, sys, {module}\n"
        f"print(json.dumps({module}.{function.__name__}(*json.loads(sys.argv[1]))))"
    )
    words = [sys.executable, "-c", program, json.dumps(arguments)]
    done = measure(words, timeout_s=timeout_s)
    if done.code != 0:
        story = "it took too long" if done.timed_out else done.errors.strip()[-2000:]
        raise RuntimeError(f"{module}.{function.__name__}{arguments}: {story}")
    return done.json()


def best(runs: int, run: Callable[[], Measured]) -> Measured:
    """The one of several runs that took the least CPU time."""
    return min((run() for _ in range(runs)), key=lambda measured: measured.cpu_s)


class _Alarm:
    """Kills a process and its children when the time is over."""

    def __init__(self, pid: int, timeout_s: float) -> None:
        self.pid = pid
        self.rung = False
        self._timer = threading.Timer(timeout_s, self.ring)
        self._timer.daemon = True
        self._timer.start()

    def ring(self) -> None:
        self.rung = True
        try:
            os.killpg(self.pid, signal.SIGKILL)  # it is the leader of its session
        except ProcessLookupError:
            return  # it ended by itself just now

    def cancel(self) -> None:
        self._timer.cancel()


def _environment() -> dict[str, str]:
    """The one of this process, with koord and the benchmarks to be found, and no colours.

    Modules are compiled once, as they are where koord is installed.
    """
    places = [str(ROOT), str(BENCHMARKS), *filter(None, [os.environ.get("PYTHONPATH")])]
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, "PYTHONPATH": os.pathsep.join(places), "NO_COLOR": "1"}


def _mib(usage: resource.struct_rusage) -> float:
    unit = 1 if sys.platform == "darwin" else 1024
    return usage.ru_maxrss * unit / 2**20


def _text(file: Any) -> str:
    file.seek(0)
    content: bytes = file.read()
    return content.decode("utf-8", "replace")


# --- reports --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table: the key of its cells, its heading, the places of its numbers."""

    key: str
    head: str
    places: int = 2


TIMES = (
    Column("wall_s", "wall s"),
    Column("cpu_s", "CPU s"),
    Column("peak_mib", "MiB", 0),
)
LIMITS = (Column("limit", "limit"), Column("met", "met"))


@dataclass
class Table:
    """Rows, each a mapping from the keys of the columns; other keys are for the JSON alone."""

    title: str
    columns: tuple[Column, ...]
    rows: list[Row] = field(default_factory=list)

    def lines(self) -> list[str]:
        cells = [[_shown(row.get(c.key), c.places) for c in self.columns] for row in self.rows]
        heads = [c.head for c in self.columns]
        widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
        numeric = [
            any(isinstance(row.get(c.key), int | float) for row in self.rows) for c in self.columns
        ]
        return [self.title, *(_line(row, widths, numeric) for row in [heads, *cells]), ""]


@dataclass
class Report:
    """What one benchmark found: tables, and answers that are wrong."""

    quick: bool = False
    tables: list[Table] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def table(self, title: str, *columns: Column) -> Table:
        """A new table; it is shown when all is measured."""
        self.tables.append(Table(title, columns))
        return self.tables[-1]

    def expect(self, right: bool, story: str) -> bool:
        """Note an answer that is wrong."""
        if not right:
            self.wrong.append(story)
        return right


def times(measured: Measured) -> dict[str, Cell]:
    """The cells of the columns ``TIMES``."""
    return {
        "wall_s": round(measured.wall_s, 4),
        "cpu_s": round(measured.cpu_s, 4),
        "peak_mib": round(measured.peak_mib, 1),
    }


#: An *unknown* that took longer may be for want of time: koord has limits of its own.
GIVEN_UP_S = 25.0


def gave_up(measured: Measured) -> bool:
    """Whether a run that knows no answer may be excused with the time that it took."""
    return measured.timed_out or (measured.code == 3 and measured.wall_s >= GIVEN_UP_S)


def limited(measured_s: float, limit_s: float | None, unit: str = "s wall") -> dict[str, Cell]:
    """The cells of the columns ``LIMITS``."""
    if limit_s is None:
        return {}
    return {"limit": f"{limit_s:g} {unit}", "limit_s": limit_s, "met": measured_s <= limit_s}


def note(text: str) -> None:
    """Say on standard error what is being measured, if somebody looks on."""
    if sys.stderr.isatty():
        print(f"  … {text}", file=sys.stderr, flush=True)


def main(name: str, story: str, benchmark: Callable[[Report], None]) -> int:
    """Run a benchmark as its command line says; the exit code."""
    parser = argparse.ArgumentParser(description=story.splitlines()[0])
    parser.add_argument(
        "--json",
        metavar="FILE",
        type=Path,
        default=RESULTS / f"{name}.json",
        help="where the result is written (benchmarks/results/)",
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, few runs")
    arguments = parser.parse_args()
    report = Report(quick=arguments.quick)
    facts = machine()
    print(_said_of(facts), end="\n\n", flush=True)
    try:
        benchmark(report)
    except KeyboardInterrupt:  # what is known by now is shown, and not kept
        show(report)
        return 130
    result = {
        "benchmark": name,
        "quick": report.quick,
        "machine": facts,
        "tables": [{"title": t.title, "rows": t.rows} for t in report.tables],
        "wrong": report.wrong,
    }
    arguments.json.parent.mkdir(parents=True, exist_ok=True)
    arguments.json.write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n", "utf-8")
    show(report)
    return 1 if report.wrong else 0


def show(report: Report) -> None:
    """Print the tables, and what is wrong."""
    for table in report.tables:
        print("\n".join(table.lines()))
    for story in report.wrong:
        print(f"WRONG: {story}")


def _shown(cell: Cell, places: int) -> str:
    match cell:
        case None:
            return NOTHING
        case bool():
            return "yes" if cell else "NO"
        case float():
            return f"{cell:,.{places}f}"
        case int():
            return f"{cell:,}"
        case _:
            return cell


def _line(cells: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> str:
    together = zip(cells, widths, numeric, strict=True)
    parts = [cell.rjust(width) if right else cell.ljust(width) for cell, width, right in together]
    return "  " + "  ".join(parts).rstrip()


# --- the machine ----------------------------------------------------------------------------------


def machine() -> dict[str, object]:
    """The facts without which a time says nothing."""
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "load": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        "packages": {name: version for name in PACKAGES if (version := _version(name))},
    }


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _said_of(facts: Mapping[str, object]) -> str:
    return (
        f"{facts['cores']} cores of {facts['cpu']}, {facts['memory_gib']} GiB, "
        f"load {facts['load']}, Python {facts['python']}, {facts['date']}"
    )
