# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `camera`: a color or gray camera. Other kinds never import this package."""

from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.cameras import LABEL_STREAMS
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Camera

KIND = SensorKind(
    spec=Camera,
    streams={
        "": CompressedImage,
        "image": Image,
        "camera_info": CameraInfo,
        **LABEL_STREAMS,
    },
    model="services.sensors.camera.model:CameraModel",
    extra="camera",
    sees_world=True,
    bulky=True,
    streamable=False,
)
