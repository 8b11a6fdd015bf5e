"""Certificates with something else in them than koord wrote, by somebody who knows of digests."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from random import Random
from typing import Any

from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import Texts, certificate, digest, shown_by
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.recheck.certificates import Document

#: Programs of which some claims hold and some do not; what holds is certified.
COUNT = """\
param int k = 1

allwrite:
    int c = 0
    int d = 0

local:
    int n = 0

Step:
    pre: n < k
    eff:
        n = n + 1
        atomic: c = c + 1

Lose:
    pre: n == k
    eff:
        n = n + 1
        d = d + 1

invariant Small: n <= k + 1
invariant Low: n <= k
invariant Counted: c <= numAgents * k
invariant Few: c <= 1
"""

DOOR = """\
allwrite:
    bool taken = false

local:
    bool inside = false

Enter:
    pre: not taken and not inside
    eff:
        atomic:
            taken = true
            inside = true

Leave:
    pre: inside
    eff:
        inside = false
        taken = false

invariant Held: forall i: inside@i implies taken
invariant Exclusive: forall i, j: inside@i and inside@j implies i == j
invariant Empty: not inside
"""

SWITCH = """\
using Lamp:
    sensors:
        int bright
    actuators:
        bool on
    contract Steady:
        ensures: bright' == bright or on
    contract Dark:
        ensures: bright' == 0
    environment:
        if on: bright = 1

local:
    int m = 0

assume: bright == 0

Press:
    pre: m < 2
    eff:
        m = m + 1
        on = m > 1

Divide:
    pre: m == 2
    eff: m = 2 / (m - 1)

invariant Bounded: 0 <= m and m <= 2
invariant Bright: bright <= 1
invariant Never: m < 2
"""

PROGRAMS = {"count.krd": COUNT, "door.krd": DOOR, "switch.krd": SWITCH}

#: Changes to programs, with which some of what was certified is false.
CHANGES = (
    ("n < k", "n <= k"),
    ("not taken and not inside", "not inside"),
    ("        atomic: c = c + 1", "        c = c + 1"),
    ("m < 2\n", "m < 3\n"),
    ("atomic:", "if true:"),
    ("m - 1", "m - 2"),
    ("int c = 0", "int c = 5"),
    ("bright = 1", "bright = 2"),
)

FILES = ("assume: false\n", "invariant Held: true\n", "invariant More: numAgents < 3\n")


@cache
def _written(file: str, robots: int) -> str:
    source, settings = Source(file, PROGRAMS[file]), Settings({})
    program = load(source, settings).program
    assert program is not None
    system = dealt(program, robots)
    # Only the first is for every number of robots: that takes longer.
    choice = None if robots == 1 else Engine.INDUCTION
    shown = shown_by(verify(system, Bounds(4, 20.0), choice))
    made = certificate(system, Texts(source, (), settings), shown, Deadline.after(30), "test")
    assert made is not None
    return json.dumps(made.document)


def pool() -> list[Document]:
    """Certificates as koord writes them; copies."""
    return [
        written("count.krd", 1),
        written("count.krd", 2),
        written("door.krd", 2),
        written("switch.krd", 2),
    ]


def written(file: str, robots: int) -> Document:
    """The certificate of one of the programs; a copy."""
    document: Document = json.loads(_written(file, robots))
    return document


#: What is false, and forged: claims as they should be called, of a program with two robots.
FALSE = (
    ("count.krd", "property", "Low"),
    ("count.krd", "property", "Few"),
    ("count.krd", "lost update", "d"),
    ("door.krd", "property", "Exclusive"),
    ("door.krd", "property", "Empty"),
    ("switch.krd", "property", "Never"),
    ("switch.krd", "fault", ""),
    ("switch.krd", "contract", "Dark"),
    ("switch.krd", "contract", "Steady"),
)


def forged(file: str, kind: str, subject: str, *, everyone: bool) -> Document:
    """A certificate that claims one thing more."""
    document = written(file, 2)
    document["claims"] = [
        c for c in document["claims"] if (c["kind"], c["subject"]) != (kind, subject)
    ]
    claim = {"name": subject, "kind": kind, "subject": "", "every_number": everyone}
    if kind != "property":
        name = f"no lost update of {subject}" if kind == "lost update" else f"contract {subject}"
        claim |= {"name": "no fault" if kind == "fault" else name, "subject": subject}
    document["claims"].append(claim)
    return document


def altered(old: str, new: str) -> Document:
    """A certificate of another program than the one that it was written for."""
    document = next(d for d in reversed(pool()) if old in d["program"]["text"])
    document["program"]["text"] = document["program"]["text"].replace(old, new)
    document["program"]["sha256"] = digest(document["program"]["text"])
    return document


def edited(random: Random) -> Document:
    """One of the certificates with some edits."""
    documents = pool()
    document = random.choice(documents)
    other = random.choice([d for d in documents if d is not document])
    edits = random.choices(EDITS, k=random.choice((1, 1, 2, 3)))
    for edit in edits:
        edit(document, other, random)
    if random.random() < 0.1:  # after which it may be no certificate any more
        _anything(document, other, random)
    return document


Edit = Callable[[Document, Document, Random], object]


def _names(document: Document) -> list[str]:
    """What claims, variables and contracts are called, here and elsewhere."""
    text = document["program"]["text"]
    words = [line.split(":")[0].split()[-1] for line in text.splitlines() if line.strip()]
    claims = [claim["name"] for claim in document["claims"]]
    built_in = ["no fault", "no lost update of d", "no lost update of c", "contract Dark"]
    return [*words, *claims, *built_in, "", "d", "c", "taken", "Dark", "Steady"]


KINDS = ("property", "fault", "lost update", "contract")


def _claim_field(document: Document, other: Document, random: Random) -> None:
    if document["claims"]:
        claim = random.choice(document["claims"])
        field = random.choice(("name", "kind", "subject", "every_number"))
        claim[field] = {
            "name": random.choice(_names(document)),
            "kind": random.choice(KINDS),
            "subject": random.choice(_names(document)),
            "every_number": not claim["every_number"],
        }[field]


def _claim_more(document: Document, other: Document, random: Random) -> None:
    """Something that the program states or is asked, called as it should be or not."""
    kind = random.choice(KINDS)
    subject = random.choice(("c", "d", "taken", "Dark", "Steady"))
    right = {
        "property": random.choice(("Low", "Few", "Exclusive", "Empty", "Never", "Small", "Held")),
        "fault": "no fault",
        "lost update": f"no lost update of {subject}",
        "contract": f"contract {subject}",
    }[kind]
    document["claims"].append(
        {
            "name": right if random.random() < 0.6 else random.choice(_names(document)),
            "kind": kind,
            "subject": subject if kind in ("lost update", "contract") else "",
            "every_number": random.random() < 0.4,
        }
    )


def _swap(part: str) -> Edit:
    def edit(document: Document, other: Document, random: Random) -> None:
        document[part] = copy.deepcopy(other[part])

    return edit


def _mix(part: str) -> Edit:
    def edit(document: Document, other: Document, random: Random) -> None:
        document[part] += copy.deepcopy(random.sample(other[part], min(1, len(other[part]))))

    return edit


def _drop(part: str) -> Edit:
    def edit(document: Document, other: Document, random: Random) -> None:
        if document[part]:
            document[part].pop(random.randrange(len(document[part])))

    return edit


def _conjunct(document: Document, other: Document, random: Random) -> None:
    if not document["invariant"]:
        return
    one = random.choice(document["invariant"])
    texts = [c["text"] for c in (*document["invariant"], *other["invariant"])]
    field = random.choice(("name", "depth", "every_number", "text", "text"))
    one[field] = {
        "name": random.choice(_names(document)),
        "depth": random.choice((1, 2, 3)),
        "every_number": not one["every_number"],
        "text": random.choice((*texts, "invariant X: true", "invariant X: false")),
    }[field]


def _program(document: Document, other: Document, random: Random) -> None:
    """Another text, of which the digest is right more often than not."""
    program = document["program"]
    program["text"] = program["text"].replace(*random.choice(CHANGES))
    if random.random() < 0.85:
        program["sha256"] = digest(program["text"])


def _digest(document: Document, other: Document, random: Random) -> None:
    document["program"]["sha256"] = other["program"]["sha256"]


def _system(document: Document, other: Document, random: Random) -> None:
    field = random.choice(("kinds", "delta", "parameters", "parameters", "tasks"))
    document[field] = {
        "kinds": [0] * random.choice((1, 2, 3)),
        "delta": random.choice(("1", "1/3", "0")),
        "parameters": random.choice(({}, {"k": 0}, {"k": 2}, {"k": "x"}, {"q": 1})),
        "tasks": random.choice((None, [["0", "0", "0"]])),
    }[field]


def _properties(document: Document, other: Document, random: Random) -> None:
    text = random.choice(FILES)
    name = random.choice(("more.krd", document["program"]["name"]))
    document["properties"].append({"name": name, "text": text, "sha256": digest(text)})
    if "assume" in text and random.random() < 0.8:
        number = len(document["rests_on"]["assumptions"]) + 1
        document["rests_on"]["assumptions"].append(f"assume_{number}")


def _rests_on(document: Document, other: Document, random: Random) -> None:
    part = document["rests_on"][random.choice(("assumptions", "contracts", "summaries"))]
    part.append("Dark") if random.random() < 0.5 or not part else part.pop()


def _script(document: Document, other: Document, random: Random) -> None:
    if not document["obligations"]:
        return
    one = random.choice(document["obligations"])
    if random.random() < 0.5:
        one["smt2"] = random.choice(("(assert false)(check-sat)", "(assert true)(check-sat)"))
        one["sha256"] = digest(one["smt2"])
    else:
        one["name"] = random.choice(document["obligations"])["name"]


def _left_out(document: Document, other: Document, random: Random) -> None:
    name = random.choice(_names(document))
    document["not_covered"].append({"name": name, "reason": "it is confirmed elsewhere"})


def _anything(document: Document, other: Document, random: Random) -> None:
    """Some part of a certificate in some other place of it."""
    places = [(holder, key) for holder, key in _places(document) if key != "smt2"]
    holder, key = random.choice(places)
    source, at = random.choice(list(_places(random.choice((document, other)))))
    holder[key] = copy.deepcopy(source[at])


def _places(value: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    keys = value if isinstance(value, dict) else range(len(value) if isinstance(value, list) else 0)
    for key in keys:
        found += [(value, key), *_places(value[key])]
    return found


EDITS: tuple[Edit, ...] = (
    _claim_field, _claim_field, _claim_field, _claim_more, _claim_more, _claim_more,
    _swap("claims"), _swap("invariant"), _swap("program"), _swap("obligations"), _swap("kinds"),
    _mix("claims"), _mix("invariant"), _drop("claims"), _drop("invariant"), _drop("obligations"),
    _conjunct, _conjunct, _program, _program, _program, _digest, _system, _system, _properties,
    _rests_on, _script, _left_out,
)  # fmt: skip


def system_printed(document: Document) -> tuple[Settings, Fraction, tuple[int, ...]]:
    """Params, δ and robots as a certificate's problem says them in ``--json``."""
    problem = document["problem"]
    params = {name: _plain(given["value"]) for name, given in problem["params"].items()}
    return Settings(params), Fraction(problem["delta"]), (0,) * problem["robots"]


def _plain(value: Any) -> Any:
    return Fraction(value["fraction"]) if isinstance(value, dict) else value
