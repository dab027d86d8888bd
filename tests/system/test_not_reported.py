# SPDX-License-Identifier: Apache-2.0
"""System test of a receiver that implements only Table 1 of the paper and sends no reports."""

import json
import socket
from pathlib import Path

import pytest

from groundlink.cli.run.up import START_SECONDS

from .rig import rig

pytestmark = pytest.mark.system


@pytest.mark.timeout(200)
def test_what_a_receiver_does_not_report_is_no_loss(tmp_path: Path) -> None:
    with rig(tmp_path) as it, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(it.peer)
        receiver.setblocking(False)
        file = tmp_path / "report.json"
        up = it.up("--no-ros", "--duration", "3", "--report", str(file))
        assert up.wait(150) == 0, it.log("up.log")
        assert receiver.recv(65536)
        told = json.loads(file.read_text(encoding="utf-8"))
        log = it.log("up.log")
    assert told["faults"] == []
    declared = [row for row in told["streams"] if row["declared_hz"] is not None]
    assert declared
    for row in declared:
        assert row["sent"] == row["in_flight"] > 0
        assert (row["lost"], row["missing"], row["reported"]) == (0, 0, False)
    assert "not reported" in log
    assert "every declared rate was kept" not in log
    assert 3 <= told["sim_seconds"] < START_SECONDS
