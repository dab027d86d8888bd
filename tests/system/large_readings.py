# SPDX-License-Identifier: Apache-2.0
"""A process that publishes large readings: `python -m tests.system.large_readings ENDPOINT KEY`."""

import sys
import time

from groundlink.bus.core_topics import Delivery
from groundlink.bus.session import Bus
from groundlink.messages.base import PointCloud

POINTS = 10_000


def reading(number: int) -> PointCloud:
    """Return the reading of a number, which is in all of its points."""
    points = bytes([number % 251]) * (22 * POINTS)
    return PointCloud(stamp_nanos=number, frame="", points=memoryview(points))


def main(endpoint: str, key: str) -> None:
    with Bus(connect=endpoint) as bus:
        publish = bus.reading_publisher(key, Delivery.ALL, bulky=True, local=True)
        number = 0
        while True:
            publish(reading(number))
            number += 1
            time.sleep(0.005)


if __name__ == "__main__":
    main(*sys.argv[1:])
