# SPDX-License-Identifier: Apache-2.0
"""Which types of the wire the streams of a run have, and how each is treated on its way.

Rule: derived from the run's streams and the wire's table of types alone. This is where the
vocabulary of the bus meets the vocabulary of the wire.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from groundlink.core.errors import UserError
from groundlink.messages.base import Message
from groundlink.messages.ground_truth import TruePoints
from groundlink.ros.cdr import ROS_CODECS
from groundlink.ros.streams import Outgoing, answers_mistake
from groundlink.scenario import Scenario
from groundlink.scenario.message_sizes import body_bytes
from groundlink.scenario.sensors import RepairBy
from udp_bridge.sender.repair import Mode, parse_mode
from udp_bridge.wire.lockstep import ExpectedResponse
from udp_bridge.wire.types import NUMBER_OF_ROS_TYPE, type_number

if TYPE_CHECKING:
    from .gateway import Gateway

TF_MESSAGE = type_number("TFMessage")


def wire_type(message: type[Message], ros_type: str = "") -> int:
    """Return the wire's number of the ROS type that a message of the bus becomes, or is read of."""
    return NUMBER_OF_ROS_TYPE[ros_type or ROS_CODECS[message].ros_type]


def waiting_table(streams: Iterable[Outgoing]) -> dict[tuple[int, str], int]:
    """Return the bytes of each stream in blocks that may wait, by wire type and topic.

    A block may be held up as long as a whole revolution would be: no data get older by it.
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
    """Return how what is lost of each stream is made good, by wire type and topic."""
    table = {}
    for stream in streams:
        said = stream.repair
        if isinstance(said, RepairBy):
            share = {"fec": said.fec} if said.fec is not None else {"resend": said.resend}
            mode = parse_mode(share)
        else:
            mode = parse_mode(said)
        if mode is not None:
            table[wire_type(stream.message), stream.topic] = mode
    return table


def answers(scenario: Scenario, gateway: Gateway) -> tuple[ExpectedResponse, ...]:
    """Return which topics ROS has to answer in lockstep.

    Raises
    ------
    UserError
        when one of them does not go to ROS.
    """
    if mistake := answers_mistake(scenario):
        raise UserError(mistake)
    types = {wish.topic: wish.msg_type for wish in gateway.incoming}
    return tuple(
        ExpectedResponse(topic, of, types.get(topic, 0))
        for topic, of in scenario.time.answers.items()
    )
