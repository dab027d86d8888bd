# SPDX-License-Identifier: Apache-2.0
"""What tests of several folders use: the laboratory, and a router on the loopback."""

from collections.abc import Iterator

import pytest

from groundlink.bus.session import Bus
from groundlink.loader import load
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario import Scenario


@pytest.fixture(scope="session")
def lab() -> Scenario:
    return load("indoor_lab")


@pytest.fixture
def endpoint() -> Iterator[str]:
    endpoint = free_endpoint()
    with Bus(listen=endpoint):
        yield endpoint
