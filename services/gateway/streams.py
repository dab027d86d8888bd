# SPDX-License-Identifier: Apache-2.0
"""Wire types of the run's streams, and how the link repairs and queues each of them."""

from collections.abc import Iterable

from groundlink.messages.base import BusMessage
from groundlink.messages.ground_truth import TruePoints
from groundlink.ros.cdr import CODECS, ROS_CODECS
from groundlink.ros.message_sizes import body_bytes
from groundlink.ros.streams import Outgoing
from groundlink.scenario.sensors import RepairBy
from udp_bridge.sender.repair import Mode, parse_mode
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import NUMBER_OF_ROS_TYPE, TYPED, type_number

from .subscribers import TopicKey

TF_MESSAGE = type_number("TFMessage")


def wire_type(message: type[BusMessage], ros_type: str = "") -> int:
    """Return the wire type of a stream's ROS type; `TYPED` for a ROS type without a number."""
    return NUMBER_OF_ROS_TYPE.get(ros_type or ROS_CODECS[message].ros_type, TYPED)


def wire_body(place: TopicKey, message: BusMessage, cdr: memoryview) -> memoryview:
    """Return the body that the wire carries: the CDR; for `TYPED`, the type's name before it."""
    if place[0] != TYPED:
        return cdr
    return memoryview(pack_typed(CODECS[type(message)].ros_type, cdr))


def queue_limits(streams: Iterable[Outgoing]) -> dict[tuple[int, str], int]:
    """Return the bytes that may wait of each stream sent in blocks, by wire type and topic.

    These are the bytes of a revolution, so a block waits no longer than a whole cloud would.
    """
    table = {}
    for stream in streams:
        if stream.in_blocks is not None:
            vehicle, lidar = stream.in_blocks
            block_bytes = body_bytes(vehicle, lidar, truth=stream.message is TruePoints)
            whole = lidar.blocks_per_revolution * block_bytes
            table[wire_type(stream.message), stream.topic] = whole
    return table


def repair_table(streams: Iterable[Outgoing]) -> dict[tuple[int, str], Mode]:
    """Return the repair mode of each stream, by wire type and topic."""
    table = {}
    for stream in streams:
        repair = stream.repair
        if isinstance(repair, RepairBy):
            share = {"fec": repair.fec} if repair.fec is not None else {"resend": repair.resend}
            mode = parse_mode(share)
        else:
            mode = parse_mode(repair)
        if mode is not None:
            table[wire_type(stream.message), stream.topic] = mode
    return table
