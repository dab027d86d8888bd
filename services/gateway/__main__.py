# SPDX-License-Identifier: Apache-2.0
"""Gateway process, started with ``python -m services.gateway``: connects a run to ROS."""

import sys
import threading
from collections.abc import Sequence

from groundlink.bus.core_topics import GATEWAY
from groundlink.bus.session import Bus
from groundlink.core.extras import process_needs
from groundlink.process import runner as process
from groundlink.process.joining import join, report_missing_kinds
from groundlink.process.name_claim import claim_name
from groundlink.ros.streams import waiting_messages
from groundlink.scenario import Scenario

with process_needs("gateway", "gateway"):
    from udp_bridge.io.memory import keep_memory

    from .bus_session import BusSession
    from .carrier import StreamCarrier, say
    from .peer_resolver import PeerResolver

SWITCH_SECONDS = 5e-4
"""Longest time that a thread waits for the interpreter lock. Python's default of 5 ms is several
times the latency of a small message."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run the gateway until `stop` is set."""
    parser = process.parser(
        GATEWAY, "Forward a run's streams to ROS, and commands from ROS to the run."
    )
    parser.add_argument(
        "--bind", metavar="HOST:PORT", help="replaces the scenario's `gateway.bind`"
    )
    parser.add_argument(
        "--peer", metavar="HOST:PORT", help="replaces the scenario's `gateway.peer`"
    )
    parser.add_argument("--key-file", metavar="FILE", help="replaces the scenario's key")
    options = parser.parse_args(arguments)
    sys.setswitchinterval(SWITCH_SECONDS)
    keep_memory()
    with Bus(connect=process.endpoint(options), name=GATEWAY) as bus:
        run, joined = join(bus, options.run, stop)
        report_missing_kinds(GATEWAY, joined)
        scenario: Scenario | None = joined
        claim = claim_name(bus, run, GATEWAY)
        session = BusSession(bus, run, claim, depth=waiting_messages(joined, run))
        resolver = PeerResolver(options.peer or joined.gateway.peer, process.address)
        try:
            while scenario is not None and resolver.wait(stop, say) is not None:
                bind = process.address(options.bind or scenario.gateway.bind)
                with StreamCarrier(session, scenario, resolver, bind, options.key_file) as carrier:
                    scenario = carrier.run(stop)
        finally:
            resolver.close()
            session.close()


if __name__ == "__main__":
    process.run(GATEWAY, main)
