# SPDX-License-Identifier: Apache-2.0
"""`groundlink check` says what a scenario would start."""

import pytest

from groundlink.__main__ import main
from groundlink.loader.scenario_files import SHIPPED


@pytest.mark.parametrize(("name", "drives"), [("indoor_lab", False), ("indoor_lab_tour", True)])
def test_route_is_printed_with_its_length(
    name: str, drives: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(SHIPPED / f"{name}.yaml")]) == 0
    assert ("route    rover/driver: 44.6 m at 0.6 m/s" in capsys.readouterr().out) is drives
