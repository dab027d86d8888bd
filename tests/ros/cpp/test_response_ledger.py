# SPDX-License-Identifier: Apache-2.0
"""The ledger of responses in C++, compared with that of the Python nodes on random calls."""

import random
import subprocess
from pathlib import Path

import pytest

from tests.udp_bridge.cpp.test_cpp import STRICT, compiler
from udp_bridge.node.response_ledger import ResponseLedger
from udp_bridge.wire.lockstep import JOINED, ExpectedResponse

from .conftest import ROS

pytestmark = pytest.mark.system

HERE = Path(__file__).parent
EXPECTED = (
    ExpectedResponse("/scan_filtered", "/scan"),
    ExpectedResponse("/map", "/scan_filtered", every=3),
    ExpectedResponse("/fused", "/imu", every=JOINED),
    ExpectedResponse("/fused", "/scan_filtered", every=JOINED),
    ExpectedResponse("/cmd_vel", "/fused"),
)
TOPICS = ("/scan", "/imu", "/scan_filtered", "/map", "/fused", "/cmd_vel", "/other")


def answer(ledger: ResponseLedger, call: str) -> str:
    """Call a ledger; return the line that the program prints."""
    verb, topic, *more = call.split(" ")
    stamp_nanos = int(more[0]) if more else None
    said = ""
    if verb == "published":
        said = "worked_on " if ledger.published(topic, stamp_nanos) else ""
    elif verb == "received":
        ledger.received(topic, stamp_nanos)
    elif verb == "forgive":
        ledger.forgive(topic)
    elif verb == "settle":
        said = "".join(f"{name}={count} " for name, count in sorted(ledger.settle()))
    else:
        said = "".join(f"{name} " for name in sorted(ledger.caused({topic})))
    return said + ledger.owing()


def random_call(rng: random.Random) -> str:
    verb = rng.choice(["published"] * 9 + ["received"] * 14 + ["forgive", "settle", "caused"])
    topic = rng.choice(TOPICS)
    if verb == "forgive":
        topic = rng.choice(EXPECTED).topic
    is_stamped = verb in ("published", "received") and rng.random() < 0.8
    return f"{verb} {topic}" + (f" {rng.randrange(-3, 6)}" if is_stamped else "")


def test_calls_are_answered_as_in_python(tmp_path: Path) -> None:
    program = tmp_path / "response_ledger"
    folders = f"-I{ROS / 'udp_bridge_cpp/include'}"
    source = HERE / "response_ledger.cpp"
    command = [compiler(), *STRICT, "-O0", folders, str(source), "-o", str(program)]
    subprocess.run(command, check=True)
    rng = random.Random(11)
    calls = [random_call(rng) for _ in range(5000)]
    rows = [f"expect {each.topic} {each.of} {each.every}" for each in EXPECTED]
    lines = "\n".join([*rows, *calls])
    done = subprocess.run([str(program)], input=lines, capture_output=True, text=True, check=True)
    ledger = ResponseLedger(EXPECTED)
    wanted = [answer(ledger, call) for call in calls]
    assert done.stdout.splitlines()[len(rows) :] == wanted
    owing = {line.removeprefix("worked_on ") for line in wanted}
    assert {"/scan_filtered", "/map", "/fused", "/cmd_vel"} <= owing
