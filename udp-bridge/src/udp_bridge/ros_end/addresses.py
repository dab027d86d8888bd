# SPDX-License-Identifier: Apache-2.0
"""Addresses as users write them, and whether a sender is the one who may send."""

from __future__ import annotations

import socket

from udp_bridge.leaving import Address

DEFAULT_BIND = "127.0.0.1:7511"
"""Where a node receives when nothing is said."""


def parse_address(text: str, *, what: str) -> Address:
    """Return host and port of ``HOST:PORT``.

    Raises
    ------
    ValueError
        When it is none; the text begins with `what`.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 0xFFFF:
        raise ValueError(f"{what} is {text!r}, which is no HOST:PORT such as {DEFAULT_BIND}")
    return host, int(port)


def resolve(address: Address) -> Address:
    """Return a peer's address by number; OSError, in one line, when there is none."""
    host, port = address
    try:
        return socket.gethostbyname(host), port
    except OSError as error:
        raise OSError(error.errno, f"peer: {host} is no known host: {error.strerror}") from None


def is_from(sender: Address, peer: Address) -> bool:
    """Tell whether a sender is the peer; port 0 is any of its host."""
    return sender[0] == peer[0] and peer[1] in (0, sender[1])
