# SPDX-License-Identifier: Apache-2.0
import pytest

from groundlink.messages.stalls import Stalls

CASES = [
    (Stalls(), ""),
    (Stalls(("rover/imu",), {"rover/imu": 5.25}), "silent: rover/imu"),
    (Stalls((), {"rover/imu": 5.25}), ""),
    (
        Stalls((), {}, {"physics": 0.25, "rover/lidar": 2.0, "rover/imu": 0.03}),
        "time stretched by 2.3 s (rover/lidar 2.0 s, physics 0.2 s)",
    ),
    (
        Stalls((), {}, {"physics": 0.6, "rover/lidar": 0.05, "rover/imu": 0.049}),
        "time stretched by 0.7 s (physics 0.6 s, rover/lidar 0.1 s)",  # none reads 0.0
    ),
    (
        Stalls((), {}, {"physics": 0.6}, 0.25),
        "time stretched by 0.6 s (physics 0.6 s), 0.2 s still to catch up",
    ),
]


@pytest.mark.parametrize(("told", "line"), CASES)
def test_what_is_told_is_read_again_and_shown_in_a_line(told: Stalls, line: str) -> None:
    assert Stalls.read({"worlds": 1} | told.counters()) == told
    assert str(told) == line
