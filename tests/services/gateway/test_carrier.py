# SPDX-License-Identifier: Apache-2.0
"""A gateway that takes up another one's work sends nothing twice."""

from typing import Any

from groundlink.messages.base import Ack, Clock, Imu, encode
from services.gateway.bus_session import predecessor_memory
from services.gateway.carrier import GatewayMemory

from .test_gateway import RUN, Bench

IMU_KEY = f"groundlink/{RUN}/rover/imu"


class Archive:
    """A bus on which physics knows the last acknowledgement of the gateway."""

    def __init__(self, *replies: bytes) -> None:
        self._replies = replies

    def query(self, key: str, parameters: str, *, seconds: float) -> dict[str, bytes]:
        assert (key, parameters) == (f"groundlink/{RUN}/state/history", "gateway")
        return {str(i): reply for i, reply in enumerate(self._replies)}


def memory(bench: Bench) -> GatewayMemory:
    return GatewayMemory(bench.gateway, None, publish=lambda ack: None)


def sample(stamp_nanos: int) -> Imu:
    zero = (0.0, 0.0, 0.0)
    return Imu(stamp_nanos, "imu_link", (0.0, 0.0, 0.0, 1.0), zero, zero, 0.0, 0.0, 0.0)


def forwarded(bench: Bench, *stamps: int) -> list[int]:
    """Return the stamps of those samples that went to ROS."""
    before = len(bench.link.sent)
    for stamp in stamps:
        bench.gateway.forward(IMU_KEY, sample(stamp), bench.link)
    return [sent["stamp"] for sent in bench.link.sent[before:]]


def test_messages_sent_before_are_not_repeated() -> None:
    first, second = Bench(), Bench()
    assert forwarded(first, 1, 2, 3) == [1, 2, 3]
    first.gateway.counts["commands"] = 17
    ack = Ack(9, 40, 40, memory(first).pack())
    bus: Any = Archive(encode(ack), b"a state")
    second.gateway.forward(f"groundlink/{RUN}/clock", Clock(100_000_000, 0, 40, 9), second.link)
    memory(second).recall(predecessor_memory(bus, RUN))
    assert forwarded(second, 2, 3, 4) == [4]
    assert second.gateway.counts["commands"] == 17


def test_gateway_without_predecessor_starts_over() -> None:
    for replies in ((), (encode(Ack(9, -1, -1)), b"a state")):
        bench = Bench()
        bus: Any = Archive(*replies)
        memory(bench).recall(predecessor_memory(bus, RUN))
        assert forwarded(bench, 1, 2) == [1, 2]
