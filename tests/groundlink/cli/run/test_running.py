# SPDX-License-Identifier: Apache-2.0
import io

import pytest
from rich.console import Console

from groundlink.cli.run import running
from groundlink.scenario.ros_side import GatewaySettings


@pytest.mark.parametrize(
    ("bind", "peer", "words"),
    [
        ("127.0.0.1:7510", "127.0.0.1:7511", []),
        ("192.0.2.1:7510", "192.0.2.2:7511", ["--peer", "192.0.2.1:0"]),
        ("0.0.0.0:7510", "192.0.2.2:7511", ["--peer", "192.0.2.2:0"]),
    ],
)
def test_a_ros_side_that_others_reach_listens_to_the_gateway_alone(
    bind: str, peer: str, words: list[str]
) -> None:
    command = running.ros_side(GatewaySettings(bind=bind, peer=peer), Console(file=io.StringIO()))
    at = command.index("--bind")
    assert command[at : at + 2 + len(words)] == ["--bind", peer, *words]
    assert ("--peer" in command) == bool(words)
