# SPDX-License-Identifier: Apache-2.0
"""System test of a bridge with a shared key, over an emulated link that changes during the run."""

import json
import secrets
import subprocess
import sys
import time
from pathlib import Path

import pytest

from udp_bridge import Link

from .rig import REPOSITORY, Observer, Rig, rig, wait_for

LINK = (sys.executable, "-m", "groundlink", "link")

pytestmark = pytest.mark.system


def change(it: Rig, *settings: str, code: int = 0) -> str:
    """Change the run's link and return what the command says."""
    words = [word for setting in settings for word in ("--set", setting)]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "groundlink",
            "link",
            "--run",
            it.run,
            "--connect",
            it.endpoint,
            *words,
        ],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_a_sealed_run_over_a_bad_link(tmp_path: Path) -> None:
    key = secrets.token_hex(32)
    key_file, report = tmp_path / "key", tmp_path / "report.json"
    key_file.write_text(key)
    key_file.chmod(0o600)
    with rig(tmp_path) as it:
        link = "{seed: 3, to_ros: {bit_errors: 1.0e-7, delay_ms: 2}}"
        text = it.scenario.read_text(encoding="utf-8")
        sealed = text.replace("gateway: {", f"gateway: {{key_file: {key_file}, link: {link}, ")
        assert sealed != text
        it.scenario.write_text(sealed, encoding="utf-8")
        observer = Observer(it)
        up = it.up("--report", str(report))
        wait_for(lambda: observer.count("/points") > 2, 60, "clouds arrive in ROS")
        with Link(("127.0.0.1", 0), it.peer) as stranger:  # without the key
            stranger.send(8, "/clock", "", 1, b"\0\1\0\0" + bytes(8))
            stranger.send(8, "/clock", "", 1, b"\0\1\0\0" + bytes(8), to=it.bind)
            assert stranger.flush(5)

        assert "did you mean `loss`?" in change(it, "to_ros.los=1", code=2)
        assert "outage True" in change(it, "to_ros.outage=true")

        def is_silent() -> bool:
            return time.monotonic() - observer.read()["/imu"][-1]["seen"] > 0.5

        wait_for(is_silent, 10, "nothing arrives in an outage")
        assert "outage False" in change(it, "to_ros.outage=false")
        seen = observer.count("/imu")
        # Two seconds of samples: the gateway has told its counters since the outage.
        wait_for(lambda: observer.count("/imu") > seen + 800, 20, "data flow again")
        up.send_signal(2)
        up.wait(30)
        counters = json.loads(report.read_text())["processes"]["gateway"]["counters"]
        assert counters["wire_refused_unsealed"] == 1
        assert counters["link_to_ros_outage"] > 0
        assert counters["link_to_ros_flipped"] > 0
        assert counters["link_to_ros_corrupted"] == counters["link_to_ros_lost"] == 0
        for file in tmp_path.iterdir():
            if file != key_file:
                assert key.encode() not in file.read_bytes(), file
