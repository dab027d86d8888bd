# SPDX-License-Identifier: Apache-2.0
"""From a measurement to a ROS 2 callback, beside plain ROS 2: ``python -m benchmarks.ros``.

Rule: ours is all of it: a sensor's process, Zenoh, the gateway, UDP Bridge, the node, DDS, a user's
node. Plain is a node that publishes the same message, DDS, the same user's node. Messages go one at
a time and in turn by both ways, so that both share the machine's moods. Ends with 1 where the ratio
of the medians is beyond what is claimed.
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import sys
import time
from contextlib import ExitStack, closing
from typing import NamedTuple

import msgspec

from benchmarks.bridge.processes import PATIENCE_S, Late, Program, Silent, python, stand_apart
from groundlink.bus.core_topics import HEALTH
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.ros_side import Stream
from groundlink.scenario.schema import Scenario

from .ends import CLOUD_BYTES, TOPICS

LOCALHOST = "127.0.0.1"
CLAIMED = {"imu": 3.0, "cloud": 2.0}
"""At most so many times plain ROS 2."""
COUNT, QUICK_COUNT, WARM_UP = 300, 30, 10
REST_S = 0.005
"""Between messages: what is left of one does not delay the next."""


class MessagePath(NamedTuple):
    """A path from a source to a callback."""

    source: Program
    listener: Program

    def send(self, name: str, patience_s: float = PATIENCE_S) -> float:
        """Return what a message took in milliseconds."""
        self.source.say(name)
        began = self.source.number()
        return (self.listener.number(patience_s) - began) / 1e6


def _ours(stack: ExitStack) -> MessagePath:
    run = f"benchmark_{os.getpid()}"
    with socket.create_server((LOCALHOST, 0)) as free:
        endpoint = f"tcp/{LOCALHOST}:{free.getsockname()[1]}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free_too:
        free_too.bind((LOCALHOST, 0))
        peer = f"{LOCALHOST}:{free_too.getsockname()[1]}"
    scenario, vehicle = _with_streams(load(SHIPPED / "indoor_lab.yaml"))
    told = msgspec.msgpack.encode(scenario)
    stack.enter_context(closing(python("udp_bridge_ros2", "--bind", peer)))
    listener = stack.enter_context(closing(python("benchmarks.ros.ends", "listener", "ours")))
    bus = stack.enter_context(Bus(listen=endpoint))
    bus.serve(scenario_key(run), lambda _: [told])
    joined = [f"--connect={endpoint}", f"--run={run}", f"--bind={LOCALHOST}:0", f"--peer={peer}"]
    stack.enter_context(closing(python("services.gateway", *joined)))
    end = time.monotonic() + PATIENCE_S
    while not bus.present(HEALTH.key_in(run, process="gateway"), seconds=1.0):
        if time.monotonic() > end:
            raise Silent("the gateway does not join the bus")
    source = python("benchmarks.ros.ends", "sensor", endpoint, run, vehicle)
    return MessagePath(stack.enter_context(closing(source)), listener)


def _plain(stack: ExitStack) -> MessagePath:
    source = stack.enter_context(closing(python("benchmarks.ros.ends", "plain")))
    listener = python("benchmarks.ros.ends", "listener", "plain")
    return MessagePath(source, stack.enter_context(closing(listener)))


def _with_streams(scenario: Scenario) -> tuple[Scenario, str]:
    """Return a scenario whose vehicle has the two streams and nothing else."""
    streams = (
        Stream(name="imu", kind="imu", topic=TOPICS["imu"], rate_hz=100.0),
        Stream(name="cloud", kind="lidar", topic=TOPICS["cloud"], rate_hz=10.0),
    )
    (vehicle,) = scenario.vehicles
    vehicle = msgspec.structs.replace(vehicle, sensors=(), streams=streams)
    return msgspec.structs.replace(scenario, vehicles=(vehicle,)), vehicle.name


def _reach(way: MessagePath, name: str) -> None:
    """Send until something arrives: who listens is found out in the background."""
    for _ in range(15):
        try:
            way.send(name, 2.0)
        except Late:
            continue
        return
    raise Silent(f"{name} never arrives")


def main() -> int:
    """Measure and print; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_COUNT} messages of each")
    count = QUICK_COUNT if parser.parse_args().quick else COUNT
    stand_apart()
    is_well = True
    with ExitStack() as stack:
        ways = [_plain(stack), _ours(stack)]
        print("| message | bytes | plain ROS 2, ms | ours, ms | ratio | at most |")
        print("|---|---|---|---|---|---|")
        for name, most in CLAIMED.items():
            for way in ways:
                _reach(way, name)
            took: list[list[float]] = [[], []]
            for i in range(count + WARM_UP):
                for which in (0, 1) if i % 2 else (1, 0):
                    took[which].append(ways[which].send(name))
                    time.sleep(REST_S)
            plain, ours = (statistics.median(row[WARM_UP:]) for row in took)
            is_well &= ours / plain <= most
            size = CLOUD_BYTES if name == "cloud" else 324
            print(
                f"| {name} | {size:,} | {plain:.3f} | {ours:.3f} | {ours / plain:.2f} | {most:g} |"
            )
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
