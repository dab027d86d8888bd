# SPDX-License-Identifier: Apache-2.0
"""A scenario with a rover in a yard, and expectations as a file has them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.expectations import Expectation

Expecting = Callable[..., Scenario]


@pytest.fixture(scope="session")
def drive() -> Scenario:
    return load(Path(__file__).with_name("drive.yaml"))


@pytest.fixture(scope="session")
def expecting(drive: Scenario) -> Expecting:
    def expect(*expectations: dict[str, Any]) -> Scenario:
        """Return the scenario with these expectations."""
        converted = msgspec.convert(expectations, tuple[Expectation, ...])
        return replace(drive, expect=converted)

    return expect
