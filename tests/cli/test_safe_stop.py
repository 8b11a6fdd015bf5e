"""An aircraft of a simulated PX4 in the air, and all ways in which its robot may come to an end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.testing.autopilot.machine import Settings
from koord.testing.sockets import Address
from tests.cli.test_mavlink import CONFIG, ERRAND
from tests.runtime.platform.autopilots import autopilot
from tests.runtime.platform.test_mavlink_process import Observer

ROOT = Path(__file__).parents[2]

#: The autopilot's own failsafe is far off: what lands it before is koord.
SETTINGS = Settings("px4", stream_loss_s=300.0, ground_loss_s=300.0)
SILENCE = ", silence: 300"

#: It never stops by itself.
FOR_EVER = ERRAND.replace("isSent and Motion.reached", "isSent and not isSent")
FAULTY = FOR_EVER.replace(
    "Stop:\n    pre: isSent and not isSent\n    eff: stop",
    "Break:\n    pre: isSent and Motion.psn.z > 0.4\n    eff: isSent = 1 / (1 - 1) > 0",
)


@contextmanager
def deployed(
    folder: Path, program: str, address: Address, *, more: str = SILENCE
) -> Iterator[subprocess.Popen[str]]:
    """`koord deploy` with one aircraft, as a process."""
    (folder / "errand.krd").write_text(program, encoding="utf-8")
    host, port = address
    text = CONFIG.format(host=host, port=port, more=more)
    (folder / "errand.yaml").write_text(text, encoding="utf-8")
    words = ["deploy", "errand.krd", "errand.yaml", "--all-local", "--arm", "--yes"]
    reset = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    run = "import sys; from koord.cli.main import main; sys.exit(main(sys.argv[1:]))"
    with subprocess.Popen(
        [sys.executable, "-c", f"{reset}; {run}", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(folder)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def landed(observer: Observer) -> None:
    """Wait until the aircraft is on the ground and disarmed."""
    observer.wait_until(lambda: observer.height_m < 0.1 and observer.armed is False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGTERM, Exit.TERMINATED),
        (signal.SIGHUP, Exit.HUNG_UP),
        (signal.SIGINT, Exit.INTERRUPTED),
    ],
)
def test_an_aircraft_lands_when_its_command_is_told_to_end(
    tmp_path: Path, number: signal.Signals, code: Exit
) -> None:
    """(P-LAST-STOP)"""
    with (
        autopilot(SETTINGS) as address,
        Observer(address) as observer,
        deployed(tmp_path, FOR_EVER, address) as process,
    ):
        observer.wait_until(lambda: observer.height_m > 0.4)
        process.send_signal(number)
        landed(observer)
        assert process.wait(30) == code


@pytest.mark.slow
def test_an_aircraft_lands_when_the_first_process_is_killed(tmp_path: Path) -> None:
    """(P-LAST-STOP) Its robot notices that it is alone."""
    with (
        autopilot(SETTINGS) as address,
        Observer(address) as observer,
        deployed(tmp_path, FOR_EVER, address) as process,
    ):
        observer.wait_until(lambda: observer.height_m > 0.4)
        process.kill()
        landed(observer)


@pytest.mark.slow
def test_an_aircraft_lands_when_its_program_has_a_fault(tmp_path: Path) -> None:
    """(P-LAST-STOP)"""
    with (
        autopilot(SETTINGS) as address,
        Observer(address) as observer,
        deployed(tmp_path, FAULTY, address) as process,
    ):
        observer.wait_until(lambda: observer.height_m > 0.4)
        landed(observer)
        said, _ = process.communicate(timeout=30)
        assert process.returncode == Exit.VIOLATED, said
        assert "division" in said


@pytest.mark.slow
def test_an_aircraft_lands_when_people_say_e_stop(tmp_path: Path) -> None:
    """(O-AT-ONCE) (G-ESTOP) And takes off again after reset and start."""
    with (
        autopilot(SETTINGS) as address,
        Observer(address) as observer,
        deployed(tmp_path, FOR_EVER, address) as process,
    ):
        observer.wait_until(lambda: observer.height_m > 0.4)
        assert said(tmp_path, "estop", "errand.yaml") == Exit.OK
        landed(observer)
        assert said(tmp_path, "order", "errand.yaml", "start") == Exit.VIOLATED
        # It is down for people a moment before it is for its robot.
        begun = time.monotonic()
        while said(tmp_path, "order", "errand.yaml", "reset") != Exit.OK:
            assert time.monotonic() - begun < 60
        assert said(tmp_path, "order", "errand.yaml", "start") == Exit.OK
        observer.wait_until(lambda: observer.height_m > 0.4)
        process.terminate()
        landed(observer)


def said(folder: Path, *words: str) -> int:
    """Say something to the robots that run; return the exit code."""
    return subprocess.run(
        [sys.executable, "-m", "koord", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(folder)},
        check=False,
        timeout=60,
    ).returncode
