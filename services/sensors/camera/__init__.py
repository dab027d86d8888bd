# SPDX-License-Identifier: Apache-2.0
"""A color or gray camera: the kind `camera`. Other kinds never import it."""

from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.cameras import Camera
from groundlink.scenario.sensor_kinds import SensorKind

KIND = SensorKind(
    spec=Camera,
    streams={
        "": CompressedImage,
        "image": Image,
        "camera_info": CameraInfo,
    },
    model="services.sensors.camera.model:CameraModel",
    extra="camera",
    sees_world=True,
    bulky=True,
    streamable=False,
)
