# SPDX-License-Identifier: Apache-2.0
import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.navigation import Odometry
from groundlink.ros.base import Base
from groundlink.ros.streams import outgoing, static_transforms


def test_odometry_goes_out_and_its_frame_is_no_place_on_the_vehicle() -> None:
    yard = load("yard")
    odom = [s for s in outgoing(yard, "run") if s.topic == "/odom"]
    assert [(s.message, s.declared_hz, s.push) for s in odom] == [(Odometry, 50.0, True)]
    placed = static_transforms(yard, 0)
    assert placed is not None
    assert "odom" not in {transform.child for transform in placed.transforms}
    assert "imu_link" in {transform.child for transform in placed.transforms}


def test_all_that_joint_states_and_tf_are_made_of_is_carried() -> None:
    for file in sorted(SHIPPED.glob("*.yaml")):
        scenario = load(file)
        carried = {stream.key for stream in outgoing(scenario, "run")}
        for vehicle in scenario.vehicles:
            needed = Base(scenario, vehicle, "run").keys
            assert {*needed.values()} <= carried, file.name
            assert ("joints" in needed) == bool(vehicle.model.joints)


@pytest.mark.parametrize("block_deg", [0.0, 15.0])
def test_blocks_of_a_cloud_name_their_lidar(block_deg: float) -> None:
    lab = load("indoor_lab")
    (rover,) = lab.vehicles
    lidar = replace(rover.sensors[0], block_deg=block_deg)
    rover = replace(rover, sensors=(lidar, *rover.sensors[1:]))
    streams = outgoing(replace(lab, vehicles=(rover,)), "run")
    in_blocks = {s.topic: s.in_blocks for s in streams if s.in_blocks is not None}
    assert in_blocks == ({lidar.topic: (rover, lidar)} if block_deg else {})
