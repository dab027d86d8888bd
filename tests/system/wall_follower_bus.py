# SPDX-License-Identifier: Apache-2.0
"""Wall follower without ROS: replaces the gateway in a run with `lockstep: ros`.

``python -m tests.system.wall_follower_bus LAPS --connect ENDPOINT --run RUN``. At each clock
message it waits until all sensors have reached that time, decides, and sends the command to
physics, as a gateway does with the commands of ROS.
"""

import struct
import threading
from collections.abc import Sequence

import numpy as np

from groundlink.bus.core_topics import ACK, CLOCK, COMMAND, GATEWAY, ROOT, Delivery
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import Ack, BusMessage, Clock, Command
from groundlink.messages.imagery import LaserScan
from groundlink.messages.navigation import Odometry
from groundlink.process import runner as process
from groundlink.process.joining import Heartbeat, join

from .wall_following import Scan, WallFollower


def float32(number: float) -> float:
    """Return what ROS's message holds of it."""
    return float(struct.unpack("<f", struct.pack("<f", number))[0])


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    parser = process.parser(GATEWAY, "Follow the wall.")
    parser.add_argument("laps", type=int)
    options = parser.parse_args(arguments)
    follower = WallFollower(options.laps)
    with Bus(connect=process.endpoint(options), name=GATEWAY) as bus:
        run, scenario = join(bus, options.run, stop)
        vehicle = scenario.vehicles[0].name
        acknowledge = bus.publisher(ACK.key_in(run, process=GATEWAY), Delivery.ALL)
        command = bus.publisher(COMMAND.key_in(run, vehicle=vehicle), COMMAND.delivery)
        types: dict[str, type[BusMessage]] = {
            CLOCK.key_in(run): Clock,
            SENSOR_TOPICS["lidar_2d"].key_in(run, vehicle=vehicle, sensor="scanner"): LaserScan,
            SENSOR_TOPICS["wheel_odometry"].key_in(
                run, vehicle=vehicle, sensor="odometry"
            ): Odometry,
        }
        acks = ACK.key_in(run, process="")

        def type_of(key: str) -> type[BusMessage] | None:
            return Ack if key.startswith(acks) else types.get(key)

        inbox: BusInbox[BusMessage] = BusInbox(depth=4096)
        bus.subscribe_in_order(f"{ROOT}/{run}/**", type_of, inbox)
        heartbeat = Heartbeat(bus, run, GATEWAY)
        ticks = dict.fromkeys(scenario.sensor_names(), -1)
        due: Clock | None = None
        wanted: list[tuple[float, float]] = []
        while not stop.is_set():
            if heartbeat.due():
                heartbeat.beat(due.tick if due else -1, {}, [])
            if (arrived := inbox.get(seconds=0.05)) is None:
                continue
            key, message = arrived
            match message:
                case Clock():
                    due = message
                case Ack():
                    ticks[key.removeprefix(acks)] = message.tick
                case LaserScan():
                    turn = float32(message.angle_min_rad), float32(message.angle_increment_rad)
                    ranges = np.frombuffer(message.ranges_m, np.float32).tolist()
                    follower.scan(Scan(message.stamp_nanos, *turn, ranges))
                case Odometry():
                    follower.odometry(message.stamp_nanos, *message.orientation[2:])
            wanted += follower.decisions()
            if due is not None and min(ticks[name] for name in scenario.sensor_names()) >= due.tick:
                for forward, turn_radps in wanted:
                    command(Command(due.stamp_nanos, (forward, 0.0, 0.0), (0.0, 0.0, turn_radps)))
                commanded = {vehicle: due.tick} if wanted else {}
                acknowledge(Ack(due.episode, due.tick, due.tick, commanded=commanded))
                due, wanted = None, []


if __name__ == "__main__":
    process.run(GATEWAY, main)
