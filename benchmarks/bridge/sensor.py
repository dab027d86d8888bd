# SPDX-License-Identifier: Apache-2.0
"""A process that puts images on the bus as a camera would: `... sensor ENDPOINT KEY WAY`.

With `router` as the way, it passes them to the router only, as a sensor on another machine does.

It reads sizes from standard input and prints for each when its publish on the bus began, in
nanoseconds of the host's monotonic clock.
"""

import sys
import time

from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.imagery import Image

from .images import random_pixels


def main(endpoint: str, key: str, way: str) -> None:
    """Publish until the input ends."""
    with Bus(connect=endpoint) as bus:
        delivery = SENSOR_TOPICS["depth_camera"].delivery
        publish = bus.reading_publisher(key, delivery, bulky=True, local=way == "local")
        for line in sys.stdin:
            size = int(line)
            data = memoryview(random_pixels(size))
            image = Image(time.time_ns(), "camera", 1, size, "mono8", size, data)
            began = time.monotonic_ns()
            publish(image)
            print(began, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
