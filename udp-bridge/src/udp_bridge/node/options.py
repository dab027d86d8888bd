# SPDX-License-Identifier: Apache-2.0
"""Options of a node, as text: command line, addresses, datagram size, repair and frame prefix."""

from __future__ import annotations

import argparse
from typing import Any, Optional

from udp_bridge.sender.repair import Mode, parse_mode
from udp_bridge.wire.fragments import DatagramSize, check_datagram_size
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.message import Address

DEFAULT_BIND = "127.0.0.1:7511"
"""Where a node receives by default."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the command-line options of a node; each is text or None."""
    parser.add_argument("--bind", metavar="HOST:PORT", help="where to receive (127.0.0.1:7511)")
    parser.add_argument("--peer", metavar="HOST:PORT", help="the only sender to accept")
    parser.add_argument(
        "--allow-any-peer",
        action="store_const",
        const="true",
        help="accept any sender, although other hosts can reach the port",
    )
    parser.add_argument("--key-file", metavar="FILE", help="key that both ends share")
    parser.add_argument("--key-env", metavar="NAME", help="environment variable with that key")
    parser.add_argument("--trace", metavar="FILE", help="write what lockstep sends and gets")


def parse_address(text: str, *, what: str) -> Address:
    """Return host and port of ``HOST:PORT``.

    Raises
    ------
    ValueError
        When the text has another form; the error begins with `what`.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 0xFFFF:
        raise ValueError(f"{what} is {text!r}; expected HOST:PORT such as {DEFAULT_BIND}")
    return host, int(port)


def parse_datagram(text: str) -> DatagramSize:
    """Return the size of sent datagrams: `mtu`, `loopback` or a number of bytes.

    Raises
    ------
    ValueError
        When the text is none of these.
    """
    try:
        return check_datagram_size(int(text) if text.isdecimal() else text)
    except BadMessage as error:
        raise ValueError(str(error)) from None


def parse_flag(text: str, *, what: str) -> bool:
    """Return the value of `true` or `false`.

    Raises
    ------
    ValueError
        When the text is neither; the error begins with `what`.
    """
    if text.lower() not in ("true", "false"):
        raise ValueError(f"{what} is {text!r}; expected true or false")
    return text.lower() == "true"


def parse_repair(text: str) -> Optional[Mode]:
    """Return the repair mode of sent messages: `none`, `resend 0.5` or `fec 0.2`.

    Raises
    ------
    ValueError
        When the text is none of these.
    """
    name, _, figure = text.strip().partition(" ")
    try:
        return parse_mode({name: float(figure)} if figure else name)
    except (BadMessage, ValueError):
        raise ValueError(
            f"repair is {text!r}; expected none, resend, `resend SECONDS` or `fec SHARE`"
        ) from None


def prefix_frames(message: Any, prefix: str) -> None:
    """Put a prefix before every frame name in a message of either ROS."""
    for part in getattr(message, "transforms", None) or (message,):
        header = getattr(part, "header", None)
        if header is not None and header.frame_id:
            header.frame_id = prefix + header.frame_id
        if getattr(part, "child_frame_id", ""):
            part.child_frame_id = prefix + part.child_frame_id
