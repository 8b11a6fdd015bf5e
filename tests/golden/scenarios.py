"""The commands whose output is frozen: for each example what a user would do with it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from koord.api.documents import DOCUMENTS
from koord.cli.main import COMMANDS
from koord.syntax.catalogue import of_programs

#: The tree that the commands are given in: files are named as in the README.
ROOT = Path(__file__).parents[2]

EXAMPLES = Path("specs/examples")

#: What a default run plays of the examples: a violation, and runs (there is a proof in the scenario
#: of layouts). The others are left to `make slow`.
QUICK = frozenset(
    {
        "broken/sum_of_ids_no_lock/verify",
        "leader_elect/run",
        "lineform/run",
        "lineform/sim",
    }
)

#: Whose problems are frozen in the forms of other tools: a small one, and one with tables.
EXPORTED = ("fischer", "leader_elect")

#: The forms, and the endings of their files.
EXPORTS = {"aiger": "aag", "vmt": "vmt", "smt2": "smt2", "tla": "tla"}

#: Examples that every engine is asked about.
EVERY_ENGINE = (
    "broken/leader_elect_early",
    "broken/sum_of_ids_no_lock",
    "leader_elect",
    "sum_of_ids",
)
ENGINES = ("abc", "bits", "bmc", "spacer", "search", "induction")

#: Examples whose certificates take long to recheck, or may end for want of time.
LONG_RECHECK = frozenset({"shapeform", "sum_of_ids"})

#: Whose counterexamples are played in a simulated world.
PLAYED = ("broken/leader_elect_restless", "broken/sum_of_ids_no_lock", "broken/task_no_lock")

#: Examples of which a round lasts the most part of a minute: few rounds of them are simulated.
LONG_ROUNDS = re.compile(r"(broken/)?(hvac|sats)")

#: Two processes, however many cores there are.
JOBS = ("--jobs", "2")


@dataclass(frozen=True, slots=True)
class Command:
    """The words after `koord`, the files that it writes, and what is read on standard input.

    Of documents the content is frozen, and where it `is_verbatim`, their layout, too.
    """

    words: tuple[str, ...]
    writes: tuple[str, ...] = ()
    stdin: str = ""
    is_verbatim: bool = False


@dataclass(frozen=True, slots=True)
class Scenario:
    """Commands one after the other in one folder; the later ones read what earlier ones wrote."""

    name: str
    commands: tuple[Command, ...]
    slow: bool


def scenarios() -> Iterator[Scenario]:
    """All that is frozen."""
    yield Scenario("help", tuple(_help()), slow=False)
    yield Scenario("schemas", tuple(_schemas()), slow=False)
    yield Scenario("explain", tuple(_explain()), slow=False)
    yield Scenario("diagnostics", tuple(_diagnostics()), slow=False)
    yield Scenario("layout", tuple(_layout()), slow=False)
    yield Scenario("configurations", tuple(_configurations()), slow=False)
    yield Scenario("kept", tuple(_kept()), slow=False)
    yield Scenario("refinement", tuple(_refinement()), slow=True)
    yield Scenario("deploy", tuple(_deploy()), slow=True)
    expected = yaml.safe_load((ROOT / EXAMPLES / "expected.yaml").read_text(encoding="utf-8"))
    for file in expected:
        example = file.removesuffix(".krd")
        for part, commands in _parts(example):
            name = f"{example}/{part}"
            yield Scenario(name, tuple(commands), slow=name not in QUICK)


def _parts(example: str) -> Iterator[tuple[str, Iterator[Command]]]:
    yield "run", _run(example)
    yield "verify", _verify(example)
    yield "sim", _sim(example)
    if example in EVERY_ENGINE:
        yield "engines", _engines(example)
    if example in EXPORTED:
        yield "export", _export(example)
    if example in PLAYED:
        yield "schedule", _schedule(example)
    if example == "task":
        yield "others", _others()


def _help() -> Iterator[Command]:
    yield Command(())
    yield Command(("--help",))
    yield Command(("--version",))
    for command in COMMANDS:
        yield Command((command.name, "--help"))


def _schemas() -> Iterator[Command]:
    for document in DOCUMENTS:
        yield Command(("schema", document))


def _kept() -> Iterator[Command]:
    """Verdicts that are found, and then known: of a proof, and of a violation."""
    for example in ("leader_elect", "broken/sum_of_ids_no_lock"):
        verify = ("verify", program_of(example), *JOBS, "--rounds", "5", "--cache")
        yield Command(verify)
        yield Command(verify)
        yield Command((*verify, "--json"))


def _explain() -> Iterator[Command]:
    yield Command(("explain",))
    for code in of_programs():
        yield Command(("explain", code))


def _diagnostics() -> Iterator[Command]:
    """Each mistake in a program, as text and as a document, and some in flags and files."""
    for entry in of_programs().values():
        yield Command(("check", "-"), stdin=entry.bad)
        yield Command(("check", "-", "--json"), stdin=entry.bad)
    old = of_programs()["K407"].bad
    yield Command(("migrate", "-"), stdin=old)
    yield Command(("migrate", "-", "--write"), stdin=old)
    yield Command(("migrate", "-", "--json"), stdin=old)
    yield Command(("migrate", "-"), stdin=of_programs()["K201"].bad)
    for words in (
        ("unknown",),
        ("verify",),
        ("verify", "missing.krd"),
        ("verify", "missing.krd", "--json"),
        ("verify", program_of("task"), "--robots", "no"),
        ("verify", program_of("task"), "--rounds", "-1"),
        ("verify", program_of("task"), "--set", "unknown=1"),
        ("verify", program_of("task"), "--property", "Unknown"),
        ("run", program_of("task"), "--delta", "0"),
        ("replay", program_of("task")),
        ("recheck", program_of("task"), "--json"),
        ("config", "check", program_of("task")),
        ("explain", "K000"),
        ("schema", "unknown"),
    ):
        yield Command(words)


def _configurations() -> Iterator[Command]:
    """Each file, and some mistakes."""
    names = sorted(path.name for path in (ROOT / EXAMPLES).glob("*.yaml"))
    for name in names:
        if name != "expected.yaml":
            yield Command(("config", "check", f"{EXAMPLES}/{name}"))
            yield Command(("config", "check", f"{EXAMPLES}/{name}", "--json"))
    for text in ("num_robots: 0\n", "unknown: 1\n", "delta: [\n", "device: {bot_type: BOAT}\n"):
        yield Command(("config", "check", "-"), stdin=text)
        yield Command(("config", "check", "-", "--json"), stdin=text)


def _layout() -> Iterator[Command]:
    """Each kind of document, as it is written."""
    program = program_of("leader_elect")
    run, sim = (("run", program, "--rounds", "1"), ("sim", program, "--rounds", "1", "--no-html"))
    for words, *writes in (
        (("check", program, "--json"),),
        ((*run, "--json", "--trace", "a.json"), "a.json"),
        ((*run, "--trace", "a.itf.json"), "a.itf.json"),
        (("replay", "a.json", "--json"),),
        (("verify", program, *JOBS, "--json", "--certificate", "p.json"), "p.json"),
        (("recheck", "p.json", "--json"),),
        ((*sim, "--json"),),
        ((*sim, "--runs", "1", "--json"),),
    ):
        yield Command(words, tuple(writes), is_verbatim=True)


def _refinement() -> Iterator[Command]:
    for target in ("engine", "network", "simulator", "protocol"):  # those on a virtual clock
        words = ("check-refinement", "--target", target, "--runs", "5", "--rounds", "4")
        yield Command(words)
        yield Command((*words, "--json"))
    yield Command(("check-refinement", "--target", "guardian"))
    yield Command(("check-refinement", "--target", "guardian", "--json"))
    for faults in ("loss", "chaos"):
        words = ("check-refinement", "--target", "network", "--faults", faults, "--runs", "10")
        yield Command((*words, program_of("task"), "--json"))


def _deploy() -> Iterator[Command]:
    words = ("deploy", program_of("task"), f"{EXAMPLES}/task.yaml", "--all-local", "--fresh")
    yield Command((*words, "--rounds", "3", "--as-fast-as-possible", "--json"))


def _run(example: str) -> Iterator[Command]:
    """What is done with a program by the rules, without a search."""
    program = program_of(example)
    yield Command(("check", program))
    yield Command(("check", program, "--json"))
    yield Command(("fmt", "--check", program))
    yield Command(("compile", program))
    run = ("run", program, "--seed", "1")
    yield Command((*run, "--rounds", "4"))
    random = (*run, "--rounds", "6", "--policy", "random")
    yield Command((*random, "--json", "--trace", "run.itf.json"), ("run.itf.json",))
    yield Command((*random, "--numbers", "double", "--trace", "run.json"), ("run.json",))
    yield Command(("replay", "run.json", "--show"))
    yield Command(("replay", "run.json", "--compiled", "--json"))


def _verify(example: str) -> Iterator[Command]:
    """A verdict, and everything that is made of it."""
    verify = ("verify", program_of(example), *JOBS, *_flags(example))
    made = ("trace.json", "proof.json", "found.krd")
    trace, certificate, found = made
    kept = ("--trace", trace, "--certificate", certificate, "--save-invariants", found)
    yield Command((*verify, "--json", *kept), made)
    yield Command(verify)
    yield Command(("replay", trace, "--show"))
    yield Command(("replay", trace, "--json"))
    if example not in LONG_RECHECK:
        yield Command(("recheck", certificate, "--json"))
        if example in EVERY_ENGINE:
            yield Command(("recheck", certificate))


def _flags(example: str) -> tuple[str, ...]:
    """What has to be said of an example for its verdict to be of interest."""
    return ("--instants",) if example == "broken/crossing" else ()


def _engines(example: str) -> Iterator[Command]:
    verify = ("verify", program_of(example), *JOBS)
    for engine in ENGINES:
        yield Command((*verify, "--engine", engine, "--rounds", "5", "--robots", "2", "--json"))
    yield Command((*verify, "--rests-on", "--explain", "--max-violations", "2", "--json"))
    yield Command((*verify, "--rests-on", "--explain", "--max-violations", "2"))
    yield Command((*verify, "--robots", "2..3", "--json"))
    yield Command((*verify, "--robots", "any", "--json"))


def _export(example: str) -> Iterator[Command]:
    for form, ending in EXPORTS.items():
        file = f"model.{ending}"
        words = ("verify", program_of(example), "--rounds", "2", "--export", form, "-o", file)
        yield Command(words, (file,))


def _schedule(example: str) -> Iterator[Command]:
    """A counterexample, played in a simulated world."""
    yield Command(("verify", program_of(example), *JOBS, "--trace", "trace.json"))
    play = ("sim", program_of(example), "--schedule", "trace.json", "--no-html")
    yield Command(play)
    yield Command((*play, "--json"))


def _sim(example: str) -> Iterator[Command]:
    """A simulated run, with every form that it is kept in."""
    program = program_of(example)
    made = ("sim.json", "sim.html", "sim.mcap")
    trace, page, recording = made
    rounds = "2" if LONG_ROUNDS.match(example) else "8"
    sim = ("sim", program, "--rounds", rounds, "--seed", "1")
    kept = ("--trace", trace, "--html", page, "--record", recording)
    yield Command((*sim, "--json", *kept), made)
    yield Command((*sim, "--no-html"))
    yield Command(("replay", trace, "--json"))
    yield Command((*sim, "--no-html", "--runs", "2", "--csv", "runs.csv", "--json"), ("runs.csv",))


def _others() -> Iterator[Command]:
    """One program with other robots than those of the configuration beside it."""
    for name in ("task_mixed", "three_cars"):
        words = ("sim", program_of("task"), f"{EXAMPLES}/{name}.yaml", "--rounds", "4")
        yield Command((*words, "--seed", "1", "--no-html", "--json"))


def program_of(example: str) -> str:
    return f"{EXAMPLES}/{example}.krd"
