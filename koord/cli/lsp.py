"""``koord lsp``: the language server, over standard input and output."""

from __future__ import annotations

import argparse
import os
import sys

from koord.cli.exits import Exit
from koord.syntax.diagnostics import refusal
from koord.syntax.source import NOWHERE


def configure(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "Editors start it; see editors/ for Visual Studio Code, Vim and Neovim. It needs pygls:\n"
        "pip install 'koord[lsp]'.\n\nexit code: 0 when the editor says so or is gone"
    )


def main(arguments: argparse.Namespace) -> int:
    try:
        from koord.lsp.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("pygls", "lsprotocol"):
            raise
        message = "pygls is needed for this and is not installed"
        raise refusal("K950", NOWHERE, message, "pip install 'koord[lsp]'") from None
    # Whatever else writes to standard output must not reach the editor.
    stdout = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    serve(sys.stdin.buffer, stdout)
    return Exit.OK
