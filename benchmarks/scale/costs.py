# SPDX-License-Identifier: Apache-2.0
"""Costs of the jobs of a run, as they follow from measurements."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundlink.bus.core_topics import BATCH_TICKS
from groundlink.core.clock import TICK_RATE_HZ

ENCODER_TICKS = TICK_RATE_HZ // 50
SCAN_TICKS = TICK_RATE_HZ // 10
READINGS_HZ = TICK_RATE_HZ + TICK_RATE_HZ / ENCODER_TICKS + TICK_RATE_HZ / SCAN_TICKS
"""Readings of a rover a second."""

STATES_HZ = TICK_RATE_HZ + TICK_RATE_HZ / BATCH_TICKS
"""Messages of states to the sensors of a host: to light ones each, to scanners in batches."""


class Costs(msgspec.Struct, frozen=True):
    """Seconds of a processor."""

    tick: float
    """Physics, for each tick."""

    tick_of_rover: float
    state: float
    """A process of light sensors, for each state."""

    state_of_other: float
    """The same, for each rover in the state."""

    state_of_own: float
    """The same, for each rover whose sensors it has, with their readings."""

    batch: float
    """A process of scanners, for each batch of states, and so on."""

    batch_of_other: float
    batch_of_own: float
    gateway_tick: float
    reading_to_ros: float
    """The gateway, for each reading: also its derived messages and its share of the truth."""

    node_tick: float
    reading_in_ros: float
    """The ROS node, for each reading."""

    router_tick: float
    router_of_rover: float
    """The router, for each tick and rover, for what local streams do not carry."""

    routed: float
    """The router, for each message between hosts."""

    framing: float = 1.0
    """Bytes on a cable for each byte of a message. Not seconds."""


def not_negative(terms: NDArray[np.float64], values: NDArray[np.float64]) -> list[float]:
    """Return the factors of a sum of few terms with the least squares, none of them negative.

    Parameters
    ----------
    terms
        shape (values, factors).
    """
    count = terms.shape[1]
    found = np.zeros(count)
    least = np.inf
    for chosen in product([False, True], repeat=count):
        factors = np.zeros(count)
        used = np.array(chosen)
        factors[used] = np.linalg.lstsq(terms[:, used], values, rcond=None)[0]
        squares = float(((terms @ factors - values) ** 2).sum())
        if factors.min() >= 0.0 and squares < least:
            found, least = factors, squares
    return [float(factor) for factor in found]


def fitted(one_host: Sequence[Mapping[str, Any]], several: Sequence[Mapping[str, Any]]) -> Costs:
    """Return the costs that explain measurements best, none of them negative.

    Parameters
    ----------
    one_host, several
        figures of `benchmarks.scale` and `benchmarks.scale.namespaces`.
    """

    def solve(role: str, hz: float, *, is_shared: bool = False) -> list[float]:
        rows = []
        # Only different numbers of processes tell what each costs from what its rovers cost.
        for row in (*one_host, *several) if is_shared else one_host:
            rovers, processes = row["rovers"], row["processes"].get(role, 1)
            terms = [processes, processes * rovers, rovers] if is_shared else [1.0, rovers]
            # Divided by the measurement, so that relative errors count.
            rows.append(np.array(terms) * hz / row["cores"][role])
        return not_negative(np.array(rows), np.ones(len(rows)))

    gateway, node = (solve(role, TICK_RATE_HZ) for role in ("gateway", "udp_bridge_ros2"))
    readings = READINGS_HZ / TICK_RATE_HZ
    alone = next(row for row in several if row["hosts"] == 1)
    routed = [
        (row["cores"]["router"] - alone["cores"]["router"])
        / (READINGS_HZ * row["rovers"] + (row["hosts"] - 1) * STATES_HZ)
        for row in several
        if row["hosts"] > 1
    ]
    costs = (
        *solve("physics", TICK_RATE_HZ),
        *solve("imu", TICK_RATE_HZ, is_shared=True),
        *solve("scanner", TICK_RATE_HZ / BATCH_TICKS, is_shared=True),
        *(gateway[0], gateway[1] / readings),
        *(node[0], node[1] / readings),
        *solve("router", TICK_RATE_HZ),
        max(0.0, float(np.mean(routed))),
    )
    return Costs(*costs)
