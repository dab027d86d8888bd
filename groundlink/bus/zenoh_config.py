# SPDX-License-Identifier: Apache-2.0
"""Zenoh settings of the bus that differ from Zenoh's defaults, with reasons. Plain data."""

import random
from typing import Any

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where physics listens by default."""

CONNECT_SECONDS = 5.0
"""Timeout for reaching the endpoint."""

ROUTER_WAIT_SECONDS = 3.0
"""Time that a router waits for a blocked receiver before it closes the connection. Senders of large
messages to that receiver wait as long; small messages take longer than the lease of 10 s to fill
their queue. Shorter than the 5 s after which a sender closes its own connection to a waiting
router, and long enough that a gateway that stops for 2 s loses nothing."""

ROUTER_KEEPALIVES = 100
"""Keep-alives of a router within the lease of 10 s. A router that closes a connection flushes it
until the next keep-alive. A new connection of the same session in that time counts as a second one
of the old: the router drops its data, then closes both. With Zenoh's default of 4 this window is
2.5 s, in which a sensor that was cut off takes itself for connected."""

OBSERVER_IDS = tuple(f"6e10{number:04x}" for number in range(1024))
"""Session ids of observers; many, so that two sessions rarely choose the same. The router drops
messages that an observer is too slow for. It waits for other receivers, so without this a suspended
viewer would stop the run."""

ROUTER_THREADS = "(rx: (worker_threads: 32), net: (worker_threads: 4))"
"""Threads of Zenoh in a router; the defaults are 2 and 1. A thread that closes a connection with
unsent data, or waits for a receiver, blocks for seconds: with the defaults, two sensors that were
cut off stopped the whole run. One thread sends, as by default: a second one doubles the context
switches. Takes effect only before a process opens its first session, as `CLIENT_THREADS` does."""

CLIENT_THREADS = "(rx: (worker_threads: 1), app: (handover: rx))"
"""Threads of Zenoh in other processes. They have one connection; one thread reads it and fills the
queues of subscribers. With the defaults, three threads, a subscriber takes twice as many context
switches. A queue of a subscriber must therefore not wait for an answer of the same session."""

_CONGESTION = "transport/link/tx/queue/congestion_control"
SENDER_QUEUE = {
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/size/data_low": 16,
    f"{_CONGESTION}/drop/wait_before_drop": 100_000,
    f"{_CONGESTION}/drop/max_wait_before_drop_fragments": 100_000,
}
"""Queue of a sender. A busy machine may not schedule a sender's thread for many ticks; the defaults
(two batches, 1 ms) then drop states although every receiver keeps up."""


def settings_of(connect: str | None, listen: str | None, *, observer: bool) -> dict[str, Any]:
    """Return the settings of a session by Zenoh's paths; arguments as of `Bus`."""
    settings: dict[str, Any] = {
        "mode": "router" if listen else "client",
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": int(CONNECT_SECONDS * 1000),
        "connect/exit_on_failure": True,
        # Reconnection. Zenoh's default periods grow to 4 s.
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
        settings["transport/link/tx/keep_alive"] = ROUTER_KEEPALIVES
        settings["qos/network"] = [
            {
                "id": "observers",
                "zids": OBSERVER_IDS,
                "messages": ["put"],
                "flows": ["egress"],
                "overwrite": {"congestion_control": "drop"},
            }
        ]
    if observer:
        settings["id"] = random.choice(OBSERVER_IDS)
    return settings
