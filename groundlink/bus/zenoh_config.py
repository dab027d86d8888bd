# SPDX-License-Identifier: Apache-2.0
"""What the bus sets in Zenoh that is not Zenoh's own choice, and why.

Rule: explicit endpoints only. Plain data: nothing is opened here.
"""

from __future__ import annotations

import random
from typing import Any

CONNECT_SECONDS = 5.0
"""How long a process tries to reach its endpoint before it gives up."""

ROUTER_WAIT_SECONDS = 3.0
"""So long a router waits for a receiver that takes nothing, before it ends the link to it. Whoever
sends to that one waits as long: only what is bulky, as what is small fills its queue in no less
than the 10 s after which a link is dead. Less than the 5 s after which a sender gives up its own
link, to a router that waits; enough for a gateway that stands still for 2 s to lose nothing."""

ROUTER_ALIVES = 100
"""Signs of life that a router gives within the 10 s of a lease. As long as from one to the next it
goes on to write what is left to a link that it closes, and meanwhile takes a new link of the same
session for one more of the old: it drops what comes by that, and then closes both. With Zenoh's own
4 that is 2.5 s, in which a sensor that was cut off believes that it is back."""

ONLOOKERS = tuple(f"6e10{number:04x}" for number in range(1024))
"""Identities of sessions that only look on, so many that two hardly choose the same. To them the
router drops what they are too slow for; for everybody else it waits, and a viewer that somebody has
stopped would stop the run."""

ROUTER_THREADS = "(rx: (worker_threads: 32), tx: (worker_threads: 16), net: (worker_threads: 4))"
"""Of Zenoh in a router, whose own are 2, 1 and 1. One that closes a link over which something was
still to go stands for 10 s, and one that waits for a receiver stands as long: two sensors that were
cut off stopped everybody. They take effect in a process that has opened no session before."""

_CONGESTION = "transport/link/tx/queue/congestion_control"
PATIENCE = {
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/size/data_low": 16,
    f"{_CONGESTION}/drop/wait_before_drop": 100_000,
    f"{_CONGESTION}/drop/max_wait_before_drop_fragments": 100_000,
}
"""A busy machine may leave a sender's thread unscheduled for many ticks. The defaults (two batches,
1 ms) then drop states although every receiver keeps up."""


def settings_of(connect: str | None, listen: str | None, *, onlooker: bool) -> dict[str, Any]:
    """Return the settings of a session, by the paths of Zenoh's configuration.

    Parameters
    ----------
    connect, listen, onlooker
        see `bus.Bus`.
    """
    settings: dict[str, Any] = {
        "mode": "router" if listen else "client",
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": int(CONNECT_SECONDS * 1000),
        "connect/exit_on_failure": True,
        # A router that was lost is looked for this often; Zenoh's own periods grow to 4 s.
        "connect/retry": {
            "period_init_ms": 250,
            "period_max_ms": 1000,
            "period_increase_factor": 2,
        },
        "listen/endpoints": [listen] if listen else [],
        "listen/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": True,
    }
    if listen:
        wait_micros = int(ROUTER_WAIT_SECONDS * 1e6)
        settings[f"{_CONGESTION}/block/wait_before_close"] = wait_micros
        settings["transport/link/tx/keep_alive"] = ROUTER_ALIVES
        settings["qos/network"] = [
            {
                "id": "onlookers",
                "zids": ONLOOKERS,
                "messages": ["put"],
                "flows": ["egress"],
                "overwrite": {"congestion_control": "drop"},
            }
        ]
    if onlooker:
        settings["id"] = random.choice(ONLOOKERS)
    return settings
