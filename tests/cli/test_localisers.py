"""`koord deploy` and `koord config check` where a localiser says where robots are."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

pytest.importorskip("natnet", reason="pip install 'koord[natnet]'")

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.cli.test_dry_run import ERRAND

CONFIG = """\
delta: 0.1
agents:
    - {pid: 0, on_device: car, position: [0, 0]}
localiser: LOCALISER
localiser_options: {server: 127.0.0.1, port: PORT, wait: 0.2MORE}
devices:
    car: {bot_type: CAR, planner: STRAIGHT, driver: sim}
world:
    bounds: {low: [-4, -4, 0], high: [4, 4, 3]}
"""


def files(folder: Path, port: int, localiser: str = "natnet", more: str = "") -> list[str]:
    program, configuration = folder / "errand.krd", folder / "errand.yaml"
    program.write_text(ERRAND, encoding="utf-8")
    text = CONFIG.replace("LOCALISER", localiser).replace("PORT", str(port)).replace("MORE", more)
    configuration.write_text(text, encoding="utf-8")
    return [str(program), str(configuration)]


def test_a_server_that_does_not_answer_is_an_error_at_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-LOCATE-START)"""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        port = bound.getsockname()[1]
        assert main(["deploy", *files(tmp_path, port), "--all-local"]) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert f"robot 0: natnet: no server answers at 127.0.0.1:{port}" in said
    assert "see `localiser` and its options" in said


def test_a_dry_run_needs_no_localiser(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """(P-LOCATE-NAME)"""
    run = files(tmp_path, 9)
    assert main(["deploy", *run, "--all-local", "--dry-run", "--rounds", "2"]) == Exit.OK, (
        capsys.readouterr()
    )


@pytest.mark.parametrize(
    ("localiser", "more", "told"),
    [
        ("natnett", "", ":4:12: error K932: car: there is no localiser natnett"),
        ("natnet", ", bodi: x", ":5:20: error K932: car: Object contains unknown field `bodi`"),
        ("gps", "", "unknown field|missing required field"),
    ],
)
def test_a_localiser_that_is_not_there_or_is_told_what_it_does_not_know(
    localiser: str, more: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-LOCATE-NAME) It is told where it stands, of all or of a device."""
    run = files(tmp_path, 9, localiser, more)
    assert main(["config", "check", run[1]]) == Exit.BAD_INPUT
    out = capsys.readouterr().out
    assert any(one in out for one in told.split("|")), out
