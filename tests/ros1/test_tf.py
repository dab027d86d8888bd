# SPDX-License-Identifier: Apache-2.0
"""What a ROS 1 user's tools make of a robot: tf2, the parameter server, services."""

from pathlib import Path

import pytest

from tests.system.rig import REPOSITORY, Rig, rig

from .conftest import Ros1

pytestmark = pytest.mark.system

SCENARIO = """
name: look
seed: 5
world: {folder}/worlds/lab.yaml
time: {{mode: lockstep, factor: 4.0, epoch: zero}}
gateway: {{bind: {bind}, peer: {peer}}}
vehicles:
  - name: rover
    model: {folder}/vehicles/rover.yaml
    tf: {{map: truth}}
    sensors:
      - {{kind: imu, datasheet: {folder}/sensors/imu_mti1.yaml, name: imu, topic: /imu,
         frame: imu_link, mount: imu}}
      - {{kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0}}
      - {{kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}}
      - {{kind: camera, name: camera, topic: /camera/image_raw, frame: camera_optical_frame,
         mount: camera, width: 64, height: 48, rate_hz: 2.0, vertical_fov_deg: 60.0}}
"""


def start(it: Rig, ros1: Ros1) -> None:
    folder = REPOSITORY / "scenarios"
    places = {"bind": it.address(it.bind), "peer": it.address(it.peer), "folder": folder}
    it.scenario.write_text(SCENARIO.format(**places), encoding="utf-8")
    ros1.bridge(it.address(it.peer))
    it.up("--no-ros")


def test_a_user_finds_the_robot(ros1: Ros1, tmp_path: Path) -> None:
    """One tree; the camera is in the map at each of 100 stamps of 5 s; services do as they say."""
    asker = Path(__file__).with_name("tf_asker.py")
    with rig(tmp_path) as it:
        looks = ros1.start(str(asker), "map", "camera_optical_frame", "5")
        looks.wait_for("ready")
        start(it, ros1)
        looks.wait_until(lambda: looks.messages("tf"), "what tf2 says", timeout_s=80)
        found, complaint, parents = looks.messages("tf")[0][1]
        assert (found, complaint) == (100, "")
        assert {*parents.values()} - parents.keys() == {"world"}, parents
        assert parents["odom"] == "map"
        assert parents["base_link"] == "odom"
        described = ros1.start("/usr/bin/rosparam", "get", "/robot_description")
        assert described.exit_code() == 0
        assert "<robot name=" in described.output

        names = ("step", "pause", "step", "state", "reset", "resume", "state")
        caller = ros1.start(str(Path(__file__).with_name("caller.py")), *names)
        assert caller.exit_code(60) == 0
        said = [line.split(": ", 2) for line in caller.lines if line.split(":")[0] in names]
        assert [name for name, *_ in said] == list(names)
        assert [done for _, done, _ in said] == ["False"] + 6 * ["True"]
        assert "the run is not paused" in said[0][2]
        tick = int(said[1][2].removeprefix("paused at tick "))
        assert [what for *_, what in said[2:5]] == [
            f"paused at tick {tick + 1}",
            f"paused at tick {tick + 1}",
            "paused at tick 0",
        ]
        assert all(what.startswith("running at tick") for *_, what in said[5:])
