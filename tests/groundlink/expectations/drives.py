# SPDX-License-Identifier: Apache-2.0
"""Messages of a made-up drive, each with its key on the bus behind the name of the run."""

from collections.abc import Sequence

import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import BusMessage, Command, packed
from groundlink.messages.ground_truth import Contact, Vitals
from groundlink.messages.navigation import Odometry, PoseStamped

EPOCH = 1_700_000_000 * NANOS
ZERO3 = (0.0, 0.0, 0.0)
NO_ERROR = packed(np.zeros(36))
LEVEL = quaternion_from_rpy(0.0, 0.0, 0.0)

Sent = tuple[str, BusMessage]


def odometry(tick: int, x_m: float, epoch: int = EPOCH) -> Sent:
    stamp, place = epoch + tick * TICK_NANOS, (x_m, -4.0, 0.2)
    message = Odometry(stamp, "world", "base", place, LEVEL, ZERO3, ZERO3, NO_ERROR, NO_ERROR)
    return "rover/ground_truth", message


def pose(tick: int, x_m: float, epoch: int = EPOCH) -> Sent:
    stamp = epoch + tick * TICK_NANOS
    return "rover/from_ros/pose", PoseStamped(stamp, "map", (x_m, -4.0, 0.0), LEVEL)


def vitals(tick: int, touched: Sequence[str] = (), epoch: int = EPOCH) -> Sent:
    contacts = tuple(Contact(name, 1.0, tick, 1) for name in touched)
    return "rover/vitals", Vitals(epoch + tick * TICK_NANOS, "rover", tick, 0.0, 0.0, contacts)


def command(tick: int, epoch: int = EPOCH) -> Sent:
    return "rover/command", Command(epoch + tick * TICK_NANOS, (1.0, 0.0, 0.0), ZERO3)


def driven(seconds: int, *, touched: Sequence[str] = (), epoch: int = EPOCH) -> list[Sent]:
    """Return the messages of a drive to the east at 1 m/s, with a touch at the last instant."""
    sent = []
    for tick in range(0, 400 * seconds + 1, 8):
        x_m = -8.0 + tick / 400
        if tick % 40 == 0:
            sent += [
                vitals(tick, touched if tick == 400 * seconds else (), epoch),
                command(tick, epoch),
                pose(tick + 4, x_m + 0.01 + 0.05, epoch),  # Between two true poses.
            ]
        sent.append(odometry(tick, x_m, epoch))
    return sent
