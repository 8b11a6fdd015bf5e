"""The stories of the codes that have no place in a program: files that cannot be used."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry
from koord.syntax.diagnostics import Severity


def _entry(code: str, title: str, story: str) -> tuple[str, Entry]:
    return code, Entry(code, title, Severity.ERROR, story, bad="", good="")


INPUT_CATALOGUE = dict(
    [
        _entry(
            "K901",
            "a file cannot be read",
            "There is no such file, it is a folder, it may not be read, or it is too large to be "
            "a program (64 MiB). The message says which.\n\n"
            "koord takes files, not folders: name them, as in `koord check specs/*.krd`. A single "
            "`-` is standard input.",
        ),
        _entry(
            "K902",
            "a file is not UTF-8",
            "Programs are UTF-8 text. The place is that of the first byte that is not: what "
            "stands before it was read.\n\n"
            "Either the file is no text, or an editor saved it in another encoding, such as "
            "UTF-16 or Latin-1; save it as UTF-8. A byte-order mark and Windows line ends are "
            "accepted.",
        ),
        _entry(
            "K903",
            "a file cannot be written",
            "The folder does not exist, the name is that of a folder, the disk is full, or the "
            "file may not be written.\n\n"
            "koord writes a new file beside the old one and then puts it in its place, so a file "
            "that could not be written is as it was before. Names given with --trace are tried "
            "before the work begins.",
        ),
        _entry(
            "K904",
            "a file holds properties only",
            "A file of invariants and assumptions is accepted by `koord check`, but there is "
            "nothing in it to run or verify. Name the program, and this file with `--with`: "
            "`koord verify app.krd --with props.krd`.",
        ),
    ]
)
