"""What all tests of the driver need: its library, and a DDS that stays on this machine."""

from __future__ import annotations

import pytest

pytest.importorskip("cyclonedds", reason="pip install 'koord[ros2]'")


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.runtime.platform.ros2.peers import LOOPBACK

    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
