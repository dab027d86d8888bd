# SPDX-License-Identifier: Apache-2.0
"""The paper's two scenarios as real ROS 1 and real ROS 2 see them: all topics, and the same bodies.

Each is run twice from one seed, once into each ROS, and recorded: in lockstep everybody is waited
for, so the same messages are to come, whatever the machine does meanwhile.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.bus.topics import sensor_outputs
from groundlink.loader import load
from groundlink.messages.base import Clock, PointCloud
from groundlink.messages.navigation import Text, Transforms
from groundlink.recording.reader import Recording
from groundlink.ros.base import Base
from groundlink.ros.cdr import ROS_CODECS
from groundlink.ros.streams import outgoing
from groundlink.ros.types import STORE
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import TfTree
from tests.ros import cloud_digest as digest
from tests.ros.conftest import LATCHED, RELIABLE, Ros
from tests.ros.processes import Process
from tests.system.rig import REPOSITORY, rig

from .conftest import Ros1

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

NANOS = 1_000_000_000
SIM_SECONDS = 2
TF_SECONDS = 2
ASKER = Path(__file__).with_name("tf_asker.py")
FRAMELESS = {ROS_CODECS[message].ros_type for message in (Clock, Text, Transforms)}
MANY_OF_ONE_INSTANT = {"/tf", "/tf_static", "/robot_description"}
"""Topics of several streams, or of what has no stamp."""
Expected = dict[str, tuple[str, float | None]]
"""By topic: ROS type and, of what has a steady rate, the rate."""


def expected(scenario: Scenario) -> Expected:
    """Return all that a node gets unasked."""
    rows: Expected = {
        stream.topic: (ROS_CODECS[stream.message].ros_type, stream.declared_hz)
        for stream in outgoing(scenario, "r")
        if stream.push
    }
    tf = ROS_CODECS[Transforms].ros_type
    for vehicle in scenario.vehicles:
        base = Base(scenario, vehicle, "r")
        for topic, message, rate_hz in base.topics:
            rows[topic] = (ROS_CODECS[message].ros_type, None if topic == "/tf" else rate_hz)
        rows[base.description_topic] = (ROS_CODECS[Text].ros_type, None)
    # On /tf are several streams; of the clock a newer message may push out the one before.
    clock = rows["/clock"][0]
    return rows | {"/tf_static": (tf, None), "/tf": (tf, None), "/clock": (clock, None)}


def text_of(name: str, bind: str, peer: str) -> str:
    text = (REPOSITORY / "scenarios" / f"{name}.yaml").read_text(encoding="utf-8")
    for folder in ("worlds", "vehicles", "sensors"):
        text = text.replace(f" {folder}/", f" {REPOSITORY}/scenarios/{folder}/")
    model = next(line for line in text.splitlines() if line.startswith("    model:"))
    return (
        text.replace(model, f"{model}\n    tf: {{map: truth}}")
        + f"\ntime: {{mode: lockstep, epoch: zero}}\ngateway: {{bind: {bind}, peer: {peer}}}\n"
    )


def check(listener: Process, rows: Expected, frames: dict[str, str]) -> dict[int, Any]:
    """Check frames, stamps and rates of what a listener has got; return digests of clouds by stamp.

    That the types are right is why there is anything: it was subscribed to by them.
    """
    digests = {}
    for topic, (ros_type, rate_hz) in rows.items():
        got = listener.messages(topic)
        assert got, f"{topic} is silent"
        stamps = [stamp for stamp, _ in got]
        frame = frames.get(topic, "")
        assert listener.frames(topic) == {None if ros_type in FRAMELESS else frame}, topic
        if topic not in MANY_OF_ONE_INSTANT:
            assert all(a < b for a, b in pairwise(stamps)), (topic, stamps)
        if rate_hz is not None:
            period = NANOS / rate_hz
            steps = [b - a for a, b in pairwise(stamps)]
            periods = [round(step / period) for step in steps]
            off = [abs(step - n * period) for step, n in zip(steps, periods, strict=True)]
            assert max(off) < 2_500_000, topic
            # A receiver without a core for a while loses a message.
            assert sum(n > 1 for n in periods) <= 1 + len(steps) // 20, (topic, periods)
        if ros_type.endswith("PointCloud2"):
            digests = {stamp: content[-1] for stamp, content in got}
    return digests


def one_tree(looks: Process, *, base_of: str) -> None:
    """Check what tf2 says: the camera is in the map at each of 100 stamps of 2 s, in one tree."""
    looks.wait_until(lambda: looks.messages("tf"), "what tf2 says", timeout_s=120)
    found, complaint, parents = looks.messages("tf")[0][1]
    assert (found, complaint) == (100, "")
    assert {*parents.values()} - parents.keys() == {"world"}, parents
    assert (parents["map"], parents["base_link"]) == ("world", base_of)


def enough(listener: Process, rows: Expected) -> bool:
    """Return whether the time is over, and each topic has come; those with a rate twice."""
    stamps = [stamp for stamp, _ in listener.messages("/clock")[-1:]]
    come = [len(listener.messages(topic)) > bool(rate) for topic, (_, rate) in rows.items()]
    return bool(stamps) and stamps[0] >= SIM_SECONDS * NANOS and all(come)


def of_recording(path: Path) -> dict[int, int]:
    found = {}
    with Recording(path) as recording:
        for row in recording.read(["/points"], from_nanos=0):
            message = STORE.deserialize_cdr(bytes(row.cdr), ROS_CODECS[PointCloud].ros_type)
            found[row.nanos] = digest.cloud_digest(message)
    return found


@pytest.mark.parametrize(
    "name", ["indoor_paper", pytest.param("outdoor_paper", marks=pytest.mark.nightly)]
)
def test_all_of_it_is_in_both_and_the_same(name: str, ros1: Ros1, ros: Ros, tmp_path: Path) -> None:
    shipped = load(REPOSITORY / "scenarios" / f"{name}.yaml")
    vehicle = replace(shipped.vehicles[0], tf=TfTree(map="truth"))
    rows = expected(replace(shipped, vehicles=(vehicle,)))
    frames = {
        output.ros_topic: sensor.frame
        for sensor in vehicle.sensors
        for output in sensor_outputs(sensor)
    }
    assert rows.keys() > frames.keys()
    recording = tmp_path / "run.mcap"
    clouds = {}
    with rig(tmp_path) as it:
        it.scenario.write_text(text_of(name, it.address(it.bind), it.address(it.peer)))
        node = ros1.bridge(it.address(it.peer))
        ears = ros1.listen(
            *((kind.replace("/msg", ""), topic) for topic, (kind, _) in rows.items())
        )
        ears.wait_for("ready")
        looks = ros1.start(str(ASKER), "map", "camera_optical_frame", str(TF_SECONDS))
        looks.wait_for("ready")
        it.up("--no-ros", "--record", str(recording))
        ears.wait_until(lambda: enough(ears, rows), "two seconds of all", timeout_s=100)
        clouds["ROS 1"] = check(ears, rows, frames)
        one_tree(looks, base_of="odom" if "/odom" in rows else "map")
        it.stop()
        assert node.end() == 0
        assert "lost 0," in node.output
        assert "refused 0" in node.output
    with rig(tmp_path) as it:
        it.scenario.write_text(text_of(name, it.address(it.bind), it.address(it.peer)))
        node, _ = ros.bridge("--bind", it.address(it.peer))
        late = {"/tf_static": LATCHED, "/robot_description": LATCHED}
        ears = ros.listen(
            *((kind, topic, late.get(topic, RELIABLE)) for topic, (kind, _) in rows.items())
        )
        it.up("--no-ros")
        ears.wait_until(lambda: enough(ears, rows), "two seconds of all", timeout_s=100)
        clouds["ROS 2"] = check(ears, rows, frames)
        it.stop()
        assert node.end() == 0
        assert "lost 0," in node.output
        assert "refused 0" in node.output
    if name == "outdoor_paper":
        clouds["MCAP"] = of_recording(recording)
        common = set.intersection(*map(set, clouds.values()))
        assert len(common) > 4 * SIM_SECONDS
        for stamp in common:
            assert len({clouds[way][stamp] for way in clouds}) == 1, stamp
