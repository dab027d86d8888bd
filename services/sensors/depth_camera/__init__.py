# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `depth_camera`. Other kinds never import this package."""

from groundlink.messages.base import PointCloud
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.cameras import LABEL_STREAMS
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import DepthCamera

KIND = SensorKind(
    spec=DepthCamera,
    streams={
        "": Image,
        "compressed": CompressedImage,
        "camera_info": CameraInfo,
        "points": PointCloud,
        "color": CompressedImage,
        "color_image": Image,
        "color_info": CameraInfo,
        **LABEL_STREAMS,
    },
    model="services.sensors.depth_camera.model:DepthCameraModel",
    extra="camera",
    sees_world=True,
    bulky=True,
    streamable=False,
)
