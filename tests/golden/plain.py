"""What a command printed and wrote, as lines of text that are the same on every machine.

Left out are times that were measured, versions, and digests of runs and of Z3's scripts. Floats are
rounded, for the last of their digits depend on the processor. The names that Z3 gives to parts of
terms, which hang on what it did before, are counted anew.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

from mcap.reader import make_reader

from koord import __version__
from tests.sim.unpacking import data_of, unpacked

#: Keys of documents, and columns of tables, whose values "…" stands for: what was measured, and
#: digests of runs, which are of all digits of floats.
LEFT_OUT = frozenset(
    {"seconds", "wall_s", "longest_s", "took_s", "late", "overdue", "behind"}
    | {"sent", "received", "drops", "digest", "written"}
    | {"sent_bytes", "arrived", "arrived_bytes", "cpu_s", "memory_mib", "threads"}
)

#: Where text tells how long something took on this machine, with the blanks before it, of which
#: there are as many as a column needs.
TIMES = re.compile(
    r"(?<!=) +\d+\.\d\d s\b"  # of `verify`
    r"|\[\d+\.\d s\]"  # of `recheck`
    r"|(?<= s in) \d+\.\d s, \d+ × real time"  # of `sim`
    r"|(?<=^trace) +[0-9a-f]{16}$"  # its digest
)

#: The same in documents of which the layout matters.
VALUES = re.compile(rf'("(?:{"|".join(sorted(LEFT_OUT))}|sha256)": )[^,}}\n]+')

#: What Z3 calls a part of a term.
Z3_NAME = re.compile(r"(?<=[$?]x)\d+\b")

FLOAT = re.compile(r"-?\d+\.\d+(e-?\d+)?")

#: Versions of koord and of the solvers that it names.
VERSIONS = re.compile(rf"\bkoord {re.escape(__version__)}|\b(?:cvc5|z3) \d+(?:\.\d+)+")


def plain_output(text: str, *, is_verbatim: bool = False) -> list[str]:
    """What a command printed: a document, or lines for people."""
    if is_verbatim:
        return _verbatim(text)
    if text.startswith(("{", "[")):
        return list(_document(text))
    return list(_lines(text))


def plain_file(file: Path, *, is_verbatim: bool = False) -> list[str]:
    """A file that a command wrote."""
    if is_verbatim:
        return _verbatim(file.read_text(encoding="utf-8"))
    match file.suffix:
        case ".json":
            return list(_document(file.read_text(encoding="utf-8")))
        case ".mcap":
            return list(_recording(file))
        case ".csv":
            return list(_table(file.read_text(encoding="utf-8")))
        case ".html":
            return list(_page(file))
        case _:
            return list(_lines(file.read_text(encoding="utf-8")))


def _verbatim(text: str) -> list[str]:
    """A document as it is laid out."""
    return list(_lines(VALUES.sub(r"\1…", text)))


def _lines(text: str) -> Iterator[str]:
    names: dict[str, int] = {}
    for line in text.splitlines():
        line = Z3_NAME.sub(lambda name: str(names.setdefault(name[0], len(names))), line)
        yield VERSIONS.sub("VERSION", TIMES.sub(" …", line)).rstrip()


def _document(text: str) -> Iterator[str]:
    """A document of JSON, a line for each of its leaves."""
    yield from _leaves("", json.loads(text))


def _leaves(path: str, value: object) -> Iterator[str]:
    match value:
        case dict() if value:
            hidden = {*LEFT_OUT, "sha256"} if isinstance(value.get("smt2"), str) else LEFT_OUT
            if "is_voter" in value:  # of a robot: the identity of its run is drawn
                hidden = {*hidden, "run"}
            for key, part in value.items():
                yield from _leaves(f"{path}.{key}", "…" if key in hidden else part)
        case list() if value and not _is_row(value):
            for at, part in enumerate(value):
                yield from _leaves(f"{path}[{at}]", part)
        case str() if "\n" in value:
            for at, line in enumerate(_lines(value)):
                yield f"{path}:{at} {line}".rstrip()
        case str():
            yield f"{path} = {json.dumps(VERSIONS.sub('VERSION', value), ensure_ascii=False)}"
        case _:
            yield f"{path} = {json.dumps(_rounded(value), ensure_ascii=False)}"


def _is_row(value: list[object]) -> bool:
    """Whether a list is short and of scalars: then it is one leaf."""
    return len(value) <= 12 and not any(isinstance(part, dict | list) for part in value)


def _rounded(value: object) -> object:
    match value:
        case float():
            return float(f"{round(value, 9):.9g}")
        case list():
            return [_rounded(part) for part in value]
        case _:
            return value


def _table(text: str) -> Iterator[str]:
    """A table of comma-separated values."""
    header, *rows = csv.reader(text.splitlines())
    yield ",".join(header)
    for row in rows:
        cells = zip(header, row, strict=True)
        yield ",".join(_cell(name, cell) for name, cell in cells)


def _cell(name: str, text: str) -> str:
    if name in LEFT_OUT:
        return "…"
    return str(_rounded(float(text))) if FLOAT.fullmatch(text) else text


def _recording(file: Path) -> Iterator[str]:
    """The channels of an MCAP file with their schemas, and each message."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            shape = "" if schema is None else f"{schema.name} {_digest(schema.data)}"
            yield f"{channel.topic} {channel.message_encoding} {shape}"
        for _, channel, message in reader.iter_messages():
            where = f"{channel.topic}@{message.log_time}"
            yield from _leaves(where, json.loads(message.data))
        for found in reader.iter_metadata():
            yield from _leaves(f"metadata {found.name}", dict(found.metadata))


def _page(file: Path) -> Iterator[str]:
    """What a page knows: its title and its data. Its code is the package's own."""
    text = file.read_bytes()
    yield from (f"page: {found}" for found in re.findall(r"<title>[^<]*", text.decode()))
    pack = unpacked(data_of(text))
    planes = {"planes": [name for name, _, _ in pack.document["planes"]]}
    yield from _leaves("page", pack.document | planes)
    for name in ("times_s", "poses", "tilts", "separations_m", "deeds"):
        plane = getattr(pack, name)
        yield f"page: {name} of shape {plane.shape}"
        for row in plane.reshape(len(plane), -1).tolist() if plane.size else ():
            yield f"page: {name} {json.dumps(_rounded(row))}"
    for time_s, robot, points in pack.paths:
        yield f"page: path of {robot} at {time_s}: {json.dumps(_rounded(points.ravel().tolist()))}"


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]
