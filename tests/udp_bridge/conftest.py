# SPDX-License-Identifier: Apache-2.0
"""A socket that is no end of a bridge."""

import socket
from collections.abc import Iterator

import pytest


@pytest.fixture
def stranger() -> Iterator[socket.socket]:
    """A bound UDP socket on loopback that sends and receives plain datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        plain.bind(("127.0.0.1", 0))
        yield plain
