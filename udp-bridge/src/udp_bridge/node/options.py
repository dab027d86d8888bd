# SPDX-License-Identifier: Apache-2.0
"""What a user can tell a node of either ROS about what it sends and publishes, as text.

Rule: text comes in, as parameters have it; who reads them is the node's business.
"""

from __future__ import annotations

import argparse
from typing import Any, Optional

from udp_bridge.sender.repair import Mode, parse_mode
from udp_bridge.wire.fragments import DatagramSize, check_datagram_size
from udp_bridge.wire.header import BadMessage


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that a node of either ROS has on its command line, each text or None."""
    parser.add_argument("--bind", metavar="HOST:PORT", help="where to receive (127.0.0.1:7511)")
    parser.add_argument("--peer", metavar="HOST:PORT", help="the only sender to listen to")
    parser.add_argument(
        "--allow-any-peer",
        action="store_const",
        const="true",
        help="listen to any sender, although other hosts can reach the port",
    )
    parser.add_argument("--key-file", metavar="FILE", help="key that both ends share")
    parser.add_argument("--key-env", metavar="NAME", help="environment variable with that key")


def parse_datagram(text: str) -> DatagramSize:
    """Return the size of the datagrams that go out: `mtu`, `loopback` or a number of bytes.

    Raises
    ------
    ValueError
        When it is none of these.
    """
    try:
        return check_datagram_size(int(text) if text.isdecimal() else text)
    except BadMessage as error:
        raise ValueError(str(error)) from None


def parse_flag(text: str, *, what: str) -> bool:
    """Return whether a text says true.

    Raises
    ------
    ValueError
        When it says neither true nor false; the error begins with `what`.
    """
    if text.lower() not in ("true", "false"):
        raise ValueError(f"{what} is {text!r}; expected true or false")
    return text.lower() == "true"


def parse_repair(text: str) -> Optional[Mode]:
    """Return how what is lost on the way back is made good: `none`, `resend 0.5` or `fec 0.2`.

    Raises
    ------
    ValueError
        When it is none of these.
    """
    name, _, figure = text.strip().partition(" ")
    try:
        return parse_mode({name: float(figure)} if figure else name)
    except (BadMessage, ValueError):
        raise ValueError(
            f"repair is {text!r}; expected none, resend, `resend SECONDS` or `fec SHARE`"
        ) from None


def prefix_frames(message: Any, prefix: str) -> None:
    """Put a prefix before every frame that a message of either ROS names."""
    for part in getattr(message, "transforms", None) or (message,):
        header = getattr(part, "header", None)
        if header is not None and header.frame_id:
            header.frame_id = prefix + header.frame_id
        if getattr(part, "child_frame_id", ""):
            part.child_frame_id = prefix + part.child_frame_id
