# SPDX-License-Identifier: Apache-2.0
"""Addresses as users write them."""

from __future__ import annotations

from udp_bridge.wire.message import Address

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
