# SPDX-License-Identifier: Apache-2.0
"""The bridge benchmark's quick run: it measures what it says, and everything arrives.

Figures are the machine's; what is asserted here would hold on any.
"""

import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytest.importorskip("sensor_msgs", reason="no ROS 2 messages here")
pytest.importorskip("matplotlib", reason="the extra `benchmarks` is not installed")
pytest.importorskip("websockets", reason="the extra `benchmarks` is not installed")

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image

from benchmarks.bridge import cpp
from benchmarks.bridge.images import IMAGE_HEAD_BYTES, image_cdr
from benchmarks.bridge.latency import QUICK_SIZES
from benchmarks.bridge.lossy import lossy_socket
from benchmarks.bridge.processes import CAP_NET_ADMIN
from benchmarks.bridge.throughput import SIZES

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[2]
TRANSPORTS = {"UDP Bridge", "from the bus", "by a router", "C program", "TCP", "ROS# way"}


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any], bytes]:
    """What one quick run printed, wrote and drew."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    folder = tmp_path_factory.mktemp("bridge")
    options = ("--quick", "--json", folder / "rows.json", "--figure", folder / "figure.png")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.bridge", *map(str, options)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads((folder / "rows.json").read_text(encoding="utf-8"))
    return done.stdout, rows, (folder / "figure.png").read_bytes()


def test_both_receivers_take_every_size(quick: tuple[str, dict[str, Any], bytes]) -> None:
    rows = quick[1]["cpp"]
    assert [row["bytes"] for row in rows] == list(cpp.SIZES)
    assert all(min(*row["us"], *row["per_s"]) > 0 for row in rows)
    assert quick[0].count("what C++ sustains in times of Python") == len(rows)


def test_every_size_goes_by_every_way(quick: tuple[str, dict[str, Any], bytes]) -> None:
    rows = quick[1]["latency"]
    assert [row["bytes"] for row in rows] == list(QUICK_SIZES)
    assert all(set(row["ms"]) == TRANSPORTS for row in rows)
    assert all(0 < ms < math.inf for row in rows for ms in row["ms"].values())


def test_every_way_reaches_a_callback(quick: tuple[str, dict[str, Any], bytes]) -> None:
    rows = quick[1]["callback"]
    assert {row["pause"] for row in rows} == {"hot", "at rest"}
    for row in rows:
        assert set(row["ms"]) == {"UDP Bridge", "TCP", "plain ROS", "ROS# way"}
        assert all(0 < ms < math.inf for ms in row["ms"].values())


def test_what_comes_from_the_bus_takes_the_longer_way(
    quick: tuple[str, dict[str, Any], bytes],
) -> None:
    largest = quick[1]["latency"][-1]["ms"]
    assert largest["from the bus"] > largest["C program"]


def test_streams_arrive_complete(quick: tuple[str, dict[str, Any], bytes]) -> None:
    rows = quick[1]["throughput"]
    assert [row["bytes"] for row in rows] == list(SIZES)
    assert all(row["delivered"] == row["sent"] > 0 for row in rows)


def test_nothing_is_lost_beside_busy_processes(quick: tuple[str, dict[str, Any], bytes]) -> None:
    rows = quick[1]["processes"]
    granted = 2 * int(Path("/proc/sys/net/core/rmem_max").read_text(encoding="ascii"))
    assert [(row["busy"], row["receiver"]) for row in rows] == [
        *((0, "node"), (0, "library"), (2, "node"), (2, "library"))
    ]
    for row in rows:
        assert row["delivered"] == row["sent"] > 0
        assert row["kernel_drops"] == 0
        assert row["receive_buffer"] == min(8 << 20, granted)


def test_a_busy_thread_and_losses_are_measured(quick: tuple[str, dict[str, Any], bytes]) -> None:
    assert len(quick[1]["thread"]) == 5
    rows = quick[1]["resending"]
    assert [row["bytes"] for row in rows] == [100_000, 1_000_000, 10_000_000]
    # On a busy machine a few may become too old to be asked for; they are counted, too.
    assert all(0.8 * row["sent"] < row["delivered"] <= row["sent"] for row in rows)
    assert sum(row["repaired"] for row in rows) > 0


def test_every_claim_is_judged_and_the_figure_drawn(
    quick: tuple[str, dict[str, Any], bytes],
) -> None:
    printed, _, figure = quick
    verdicts = [line for line in printed.splitlines() if "claimed at" in line]
    # From the bus, to a callback, streams, receivers in C++, busy processes, losses.
    assert len(verdicts) == len(QUICK_SIZES) + 2 + 5 + 2 + 3 + 3 + 3
    assert figure.startswith(b"\x89PNG")


def test_the_filter_loses_its_share() -> None:
    count, share = 4000, 0.05
    receiver = lossy_socket(share, receive_buffer=8 << 20)
    sender = lossy_socket(0.0, receive_buffer=8 << 20)
    buffer = bytearray(64)
    came = 0
    for _ in range(count // 100):
        for _ in range(100):
            assert sender.send([b"datagram"], receiver.address)
        while (got := receiver.receive_into(buffer)) is not None:
            came += buffer[: got[0]] == b"datagram"
    receiver.close()
    sender.close()
    deviation = math.sqrt(count * share * (1 - share))
    assert abs(count - came - count * share) < 5 * deviation


def test_what_is_measured_has_no_right_to_a_larger_receive_buffer() -> None:
    code = "from benchmarks.bridge.processes import *; drop_privileges()"
    code += "; subprocess.run(['cat', '/proc/self/status'], check=True)"
    command = [sys.executable, "-c", code]
    status = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (effective,) = re.findall(r"^CapEff:\s*([0-9a-f]+)$", status, re.MULTILINE)
    assert not int(effective, 16) & 1 << CAP_NET_ADMIN


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # what rclpy imports
@pytest.mark.parametrize("size", [100, 1_000, 1_000_001])
def test_an_image_is_one_for_ros_and_has_the_wanted_size(size: int) -> None:
    body = image_cdr(size)
    image = deserialize_message(body, Image)
    assert len(body) == size
    assert (image.header.frame_id, image.encoding) == ("camera", "mono8")
    assert image.width == image.step == len(image.data) == size - IMAGE_HEAD_BYTES
