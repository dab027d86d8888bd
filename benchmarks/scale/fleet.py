# SPDX-License-Identifier: Apache-2.0
"""A scenario of many rovers in the shipped yard, and the commands that drive them."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from groundlink.bus.core_topics import CLOCK, COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_RATE_HZ
from groundlink.messages.base import Clock, Command

SHIPPED = Path(__file__).parents[2] / "scenarios"
IN_ROW = 12
APART_M = 5.0, 3.0
FIRST_M = -27.5, -18.0
"""Rows in the free south of the yard. Each rover sees others, the hall and the wall."""

MOST = 36
COMMAND_TICKS = TICK_RATE_HZ // 10
SPEED_MPS, TURN_RADPS = 0.3, 0.6
"""Circles of half a meter."""


def free_address() -> str:
    """Return a free UDP address of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def fleet(folder: Path, rovers: int) -> Path:
    """Write a scenario of rovers, each with a scanner at 10 Hz, an IMU at 400 Hz and encoders."""
    if not 0 < rovers <= MOST:
        raise ValueError(f"{rovers} rovers; expected 1 to {MOST}, for which the yard has room")
    sensors = [
        {"kind": "lidar_2d", "datasheet": str(SHIPPED / "sensors/rplidar_a2.yaml")}
        | {"name": "scanner", "topic": "scan", "frame": "scan_link"}
        | {"mount": {"xyz_m": [0.25, 0.0, 0.36]}},
        {"kind": "imu", "datasheet": str(SHIPPED / "sensors/imu_mti1.yaml")}
        | {"name": "imu", "topic": "imu", "frame": "imu_link", "mount": "imu"},
        {"kind": "encoders", "name": "encoders", "topic": "wheel_encoders", "frame": "base_link"}
        | {"rate_hz": 50.0, "ticks_per_revolution": 80914},
    ]
    vehicles = [
        {
            "name": f"r{number}",
            "model": str(SHIPPED / "vehicles/rover.yaml"),
            "placement": {
                axis: first + apart * place
                for axis, first, apart, place in zip(
                    ("x_m", "y_m"), FIRST_M, APART_M, divmod(number, IN_ROW)[::-1], strict=True
                )
            },
            "sensors": sensors,
        }
        for number in range(rovers)
    ]
    document = {
        "name": "fleet",
        "world": str(SHIPPED / "worlds/yard.yaml"),
        "gateway": {"bind": free_address(), "peer": free_address()},
        "vehicles": vehicles,
    }
    file = folder / "fleet.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    return file


@contextmanager
def driven(bus: Bus, run: str, rovers: int) -> Iterator[None]:
    """Command the rovers of a run ten times a second of sim time, as their stacks would."""
    publishers = [
        bus.publisher(COMMAND.key_in(run, vehicle=f"r{number}"), COMMAND.delivery)
        for number in range(rovers)
    ]
    clocks: BusInbox[Clock] = BusInbox(depth=16)
    bus.subscribe(CLOCK.key_in(run), Clock, clocks)
    ended = threading.Event()

    def command() -> None:
        next_tick = 0
        while not ended.is_set():
            arrived = clocks.get(seconds=0.1)
            if arrived is not None and (clock := arrived[1]).tick >= next_tick:
                next_tick = clock.tick + COMMAND_TICKS
                for publish in publishers:
                    publish(Command(clock.stamp_nanos, (SPEED_MPS, 0, 0), (0, 0, TURN_RADPS)))

    thread = threading.Thread(target=command, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
