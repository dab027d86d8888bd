# SPDX-License-Identifier: Apache-2.0
"""Fixtures of all system tests."""

import pytest

from groundlink.bus.session import Bus
from groundlink.monitor.process_commands import free_endpoint


@pytest.fixture(scope="session", autouse=True)
def _threads_of_a_router() -> None:
    """Have as many of Zenoh's threads as a router, for some tests' own process is one.

    Zenoh makes them at a process's first session, and a router of few threads stands still while it
    closes links to processes that were killed.
    """
    with Bus(listen=free_endpoint()):
        pass
