# SPDX-License-Identifier: Apache-2.0
"""Latency from a measurement to a ROS 2 callback: ``python -m benchmarks.ros``.

Our path is a sensor process, Zenoh, the gateway, UDP Bridge, the node, DDS and a user's node. The
plain path is a node that publishes the same message, DDS and the same user's node. Messages take
both paths in turn, one at a time, so that load of the machine affects both. The exit code is 1 if
the ratio of the medians is beyond the claim.
"""

import argparse
import socket
import statistics
import sys
import time
from contextlib import ExitStack, closing
from functools import partial
from typing import NamedTuple

import msgspec

from benchmarks.bridge.bridge_transports import joined_gateway, reach
from benchmarks.bridge.processes import (
    TIMEOUT_S,
    LineProcess,
    drop_privileges,
    python,
)
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.ros_side import Stream
from groundlink.scenario.schema import Scenario

from .ends import CLOUD_BYTES, TOPICS

LOCALHOST = "127.0.0.1"
CLAIMED = {"imu": 3.0, "cloud": 2.0}
"""Largest ratio to plain ROS 2."""
COUNT, QUICK_COUNT, WARM_UP = 300, 30, 10
REST_S = 0.005
"""Pause between messages, so that one does not delay the next."""


class MessagePath(NamedTuple):
    """A path from a source to a callback."""

    source: LineProcess
    listener: LineProcess

    def send(self, name: str, timeout_s: float = TIMEOUT_S) -> float:
        """Return the latency of a message in milliseconds."""
        self.source.say(name)
        sent_nanos = self.source.number()
        return (self.listener.number(timeout_s) - sent_nanos) / 1e6


def _ours(stack: ExitStack) -> MessagePath:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free_too:
        free_too.bind((LOCALHOST, 0))
        peer = f"{LOCALHOST}:{free_too.getsockname()[1]}"
    scenario, vehicle = _with_streams(load(SHIPPED / "indoor_lab.yaml"))
    stack.enter_context(closing(python("udp_bridge_ros2", "--bind", peer)))
    listener = stack.enter_context(closing(python("benchmarks.ros.ends", "listener", "ours")))
    run, endpoint = joined_gateway(stack, scenario, peer)
    source = python("benchmarks.ros.ends", "sensor", endpoint, run, vehicle)
    return MessagePath(stack.enter_context(closing(source)), listener)


def _plain(stack: ExitStack) -> MessagePath:
    source = stack.enter_context(closing(python("benchmarks.ros.ends", "plain")))
    listener = python("benchmarks.ros.ends", "listener", "plain")
    return MessagePath(source, stack.enter_context(closing(listener)))


def _with_streams(scenario: Scenario) -> tuple[Scenario, str]:
    """Return a scenario whose vehicle has the two streams alone."""
    streams = (
        Stream(name="imu", kind="imu", topic=TOPICS["imu"], rate_hz=100.0),
        Stream(name="cloud", kind="lidar", topic=TOPICS["cloud"], rate_hz=10.0),
    )
    (vehicle,) = scenario.vehicles
    vehicle = msgspec.structs.replace(vehicle, sensors=(), streams=streams)
    return msgspec.structs.replace(scenario, vehicles=(vehicle,)), vehicle.name


def main() -> int:
    """Measure and print; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_COUNT} messages of each")
    count = QUICK_COUNT if parser.parse_args().quick else COUNT
    drop_privileges()
    is_well = True
    with ExitStack() as stack:
        paths = [_plain(stack), _ours(stack)]
        print("| message | bytes | plain ROS 2, ms | ours, ms | ratio | at most |")
        print("|---|---|---|---|---|---|")
        for name, most in CLAIMED.items():
            for path in paths:
                reach(partial(path.send, name, 2.0))
            took: list[list[float]] = [[], []]
            for i in range(count + WARM_UP):
                for which in (0, 1) if i % 2 else (1, 0):
                    took[which].append(paths[which].send(name))
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
