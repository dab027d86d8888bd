# SPDX-License-Identifier: Apache-2.0
"""Ground truth and mounts of a run, from its recording. No estimator gets them."""

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from experiments.estimation.trajectories import Trajectory
from groundlink.ros.streams import TF_STATIC_TOPIC
from groundlink.ros.types import STORE, nanos
from groundlink.scenario import Scenario


def truth_of(recording: Path, scenario: Scenario) -> Trajectory:
    """Return world_from_base of the first vehicle."""
    topic = scenario.ground_truth_topic(scenario.vehicles[0])
    rows = []
    with recording.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages([topic]):
            odometry: Any = STORE.deserialize_cdr(message.data, "nav_msgs/msg/Odometry")
            place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
            seconds = nanos(odometry.header.stamp) / 1e9
            rows.append((seconds, place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))
    table = np.array(rows, np.float64)
    return Trajectory(table[:, 0], table[:, 1:4], table[:, 4:8])


def frames_of(recording: Path) -> dict[str, list[float]]:
    """Return base_from_frame of each sensor's frame: x, y, z, qx, qy, qz, qw."""
    found = {}
    with recording.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages([TF_STATIC_TOPIC]):
            tree: Any = STORE.deserialize_cdr(message.data, "tf2_msgs/msg/TFMessage")
            for link in tree.transforms:
                t, q = link.transform.translation, link.transform.rotation
                found[link.child_frame_id] = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
    return found
