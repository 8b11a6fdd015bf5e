"""``koord conform``: what is printed, its exit codes, and mistakes in its arguments."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import koord
from koord.cli.main import main
from koord.testing.conformance import CommandPeer

FAULTY = ("--driver", "tests.testing.faulty:Faulty")

SIM = ("conform", "--driver", "sim", "--vehicle", "DIFF")


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    code = main(words)
    told = capsys.readouterr()
    return code, told.out, told.err


def test_each_check_is_a_line_with_what_was_seen(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, *SIM, "--only", "holds", "--only", "battery")
    assert code == 0
    battery, holds, *_, last = out.splitlines()
    assert battery.startswith("skipped battery      the driver tells of no battery")
    assert holds.startswith("passed  holds        it stopped within 0.0")
    assert last == "sim, DIFF: 2 checks, 1 passed, 1 skipped"


def test_what_fails_is_told_by_the_exit_code_too(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("conform", "--driver", "tests.testing.faulty:Faulty", "--vehicle", "DIFF")
    code, out, _ = run(capsys, *words, "--virtual-time", "--only", "opens", "--json")
    told = json.loads(out)
    assert code == 1
    assert (told["format"], told["ok"]) == ("koord-conformance", False)
    (check,) = told["checks"]
    assert check["measures"][-1]["seen"] == "it does not open: nobody is there; switch it on"


def test_nothing_that_could_be_checked_is_no_success(capsys: pytest.CaptureFixture[str]) -> None:
    """(P-KIT)"""
    code, out, _ = run(capsys, *SIM, "--only", "stale")
    assert code == 3
    assert "--peer COMMAND" in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "--driver: say which, or a peer that koord has: crazyflie, ros1"),
        (("--driver", "simm"), "did you mean sim?"),
        (("--driver", "nowhere:Car"), "No module named 'nowhere'"),
        (("--driver", "math:nothing"), "has no attribute 'nothing'"),
        (("--driver", "math:pi"), "it has to be callable, and to have OPTIONS"),
        (("--driver", "sim", "--vehicle", "TANK"), "--vehicle: there is no TANK"),
        (("--driver", "sim", "--only", "hold"), "--only: there is no check hold; did you mean hol"),
        (("--driver", "sim", "--room", "1"), "--room: the vehicle needs 2 m about it"),
        (("--driver", "sim", "--at", "here"), "--at: 'here' is no place"),
        (("--driver", "sim", "--peer", "sleep 9"), "--peer: it is a process, and virtual time"),
        (("--driver", "mavlink", "--peer", "'"), "--peer: `'` is no command"),
        (("--driver", "sim", "--jobs", "2"), "--jobs: there is one vehicle; checks side by side"),
        (("--peer", "px4", "--jobs", "0"), "--jobs: it is 1 at least"),
        ((*FAULTY, "--peer", "sleep 9", "--jobs", "2"), "--jobs: all peers would be the same one"),
        (
            (*FAULTY, "--peer", "sleep {free}", "--jobs", "2"),
            "--jobs: all drivers would look for the same peer",
        ),
    ],
)
def test_mistakes_in_the_arguments_are_named(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], told: str
) -> None:
    """(P-KIT-JOBS): among others, that there is one vehicle, or one peer, for several jobs."""
    code, _, error = run(capsys, "conform", *words)
    assert code == 2
    assert told in error


def test_options_come_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = tmp_path / "options.yaml"
    options.write_text("speed: 3\n", encoding="utf-8")
    code, _, error = run(capsys, *SIM, "--options", str(options))
    assert code == 2
    assert "unknown field `speed`" in error


def test_a_peer_that_does_not_start_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("conform", "--driver", "tests.testing.faulty:Faulty", "--only", "opens", "--peer")
    code, out, _ = run(capsys, *words, "sh -c 'echo the port is taken; exit 1'")
    assert code == 1
    assert "has ended: the port is taken" in " ".join(out.split())


def test_a_peer_is_asked_where_the_vehicle_is() -> None:
    """(P-KIT-PEER)"""
    told = '{"east": 1.0, "north": 2.0, "heading": 0.5, "more": 1}'
    peer = CommandPeer(["sh", "-c", f"echo hello; echo '{told}'; sleep 60"])
    peer.start()
    seen = peer.truth()
    peer.stop()
    assert seen is not None
    assert (seen.position_m, seen.heading, seen.armed) == ((1.0, 2.0, 0.0), 0.5, None)
    assert not peer.is_running


def test_it_is_a_call_as_well() -> None:
    heard: list[str] = []
    only = ("opens", "e-stop")
    told = koord.conform(
        "sim", vehicle="CAR", only=only, progress=lambda one: heard.append(one.message)
    )
    assert told.ok
    assert [one.check for one in told.findings] == ["opens", "e-stop"]
    assert repr(told) == "<Conformance of sim: 2 passed, nothing failed>"
    assert heard == ["opens in time, and says where the vehicle is", "stands soon after the order"]
    assert "<td>e-stop</td><td>passed</td>" in told._repr_html_()


def test_it_can_be_cut_short() -> None:
    stop = koord.Cancellation()
    stop.cancel()
    told = koord.conform("sim", only=("opens", "holds"), cancellation=stop)
    assert told.interrupted
    assert not told.ok
    assert told.findings == ()
