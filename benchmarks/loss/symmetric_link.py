# SPDX-License-Identifier: Apache-2.0
"""A virtual link with one topic and the same impairment both ways."""

from groundlink.core.clock import NANOS
from groundlink.emulation.model import LinkDirection
from groundlink.emulation.settings import Impairment
from services.gateway.virtual_link import VirtualLink
from udp_bridge import Message
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.fragments import DatagramSize

MSG_TYPE, TOPIC, LINK = 1, "/points", "lidar"


class SymmetricLink(VirtualLink):
    """A sender, a receiver and a link with the same impairment both ways.

    Parameters
    ----------
    mode
        Repair mode; None for no repair.
    """

    def __init__(
        self,
        impairment: Impairment,
        *,
        seed: int,
        datagram: DatagramSize = "mtu",
        mode: Mode | None = None,
    ) -> None:
        super().__init__(
            NANOS,
            LinkDirection(impairment, seed=seed, direction="there"),
            LinkDirection(impairment, seed=seed, direction="back"),
            datagram=datagram,
            repair={} if mode is None else {(MSG_TYPE, TOPIC): mode},
        )

    def send(self, body: bytes) -> None:
        """Send a message stamped with the current time."""
        self.queue.put(Message(MSG_TYPE, TOPIC, LINK, self.now_nanos, 0, body))

    def impair(self, impairment: Impairment) -> None:
        """Change the impairment of both directions."""
        self.there.settings = self.back.settings = impairment
