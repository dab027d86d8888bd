# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `lidar`: a spinning LiDAR. Other kinds never import this package."""

from groundlink.messages.base import PointCloud
from groundlink.messages.ground_truth import Detections3D, LabeledPoints, LabelTable, TruePoints
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Lidar

KIND = SensorKind(
    spec=Lidar,
    streams={
        "": PointCloud,
        "truth": TruePoints,
        "labeled_points": LabeledPoints,
        "label_info": LabelTable,
        "instance_info": LabelTable,
        "boxes_3d": Detections3D,
    },
    model="services.sensors.lidar.model:LidarModel",
    native="services.sensors.lidar.native:native_device",
    sees_world=True,
    bulky=True,
    disturb={"range": "services.sensors.faults.point_effects:offset_range"},
    cover="services.sensors.faults.point_effects:cover",
)
