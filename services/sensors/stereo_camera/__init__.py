# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `stereo_camera`. Other kinds never import this package."""

from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.cameras import LABEL_STREAMS
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import StereoCamera

KIND = SensorKind(
    spec=StereoCamera,
    streams={
        "": Image,
        "compressed": CompressedImage,
        "camera_info": CameraInfo,
        "right": Image,
        "right_compressed": CompressedImage,
        "right_camera_info": CameraInfo,
        **LABEL_STREAMS,
    },
    model="services.sensors.stereo_camera.model:StereoCameraModel",
    extra="camera",
    sees_world=True,
    bulky=True,
    streamable=False,
)
