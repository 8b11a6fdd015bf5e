"""Nothing is armed that people have not said may move. (P-ARM)"""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.group import TICK_S
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from tests.runtime.platform.test_driven import Guarded


@pytest.mark.parametrize("arms", [False, True])
def test_a_vehicle_is_armed_if_people_said_so(arms: bool) -> None:
    driven = Guarded("CAR").driven
    host = cast(VehicleHost, SimpleNamespace(kinds=(0,)))
    made = VehiclePlatform(host, driven, stated=Stated(), arms=arms)
    now = 100.0
    for _ in range(100):
        now += TICK_S
        made.tick(now, 0.05, None)
    assert driven.mode is (Mode.RUNNING if arms else Mode.DISARMED)
    assert any("not to be armed" in remark for remark in made.remarks) is not arms


def test_what_is_said_of_a_vehicle_does_not_grow_for_ever() -> None:
    """Of one that is to start, and may not."""
    driven = Guarded("CAR").driven
    made = VehiclePlatform(cast(VehicleHost, SimpleNamespace(kinds=(0,))), driven, stated=Stated())
    now = 100.0
    for _ in range(600):
        now += TICK_S
        made.tick(now, 5.0, None)
    assert driven.mode is Mode.ARMED
    assert 200 < len(driven.notes) <= 256
