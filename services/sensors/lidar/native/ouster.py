# SPDX-License-Identifier: Apache-2.0
"""Packet output of Ouster devices, and the metadata that decoders of the packets need.

A packet has 16 columns; each column is one firing of all lasers. Frames are revolutions of the run.
The device's clock is the run's, as if it were synchronized by PTP.
"""

import json
import zlib
from functools import partial

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.messages.base import PointCloud
from services.sensors.lidar.spec import Lidar
from services.sensors.runtime.model import Datagram

from . import ouster_packets as packets
from .packet_stream import TurningStream, require

MODES = {
    (columns, rate_hz): f"{columns}x{rate_hz}"
    for columns, rate_hz in ((512, 10), (1024, 10), (2048, 10), (512, 20), (1024, 20))
}
"""Mode of the device by firings per revolution and revolutions per second."""

LASERS = (16, 32, 64, 128)

_FIELDS_OF_VIEW_DEG = {"OS-0": 90.0, "OS-1": 42.4, "OS-2": 22.5}
_HALF_TURN = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
_INITIALIZATION_ID = 1


class Ouster:
    """Packet output of a LiDAR (a `NativeLidar`).

    Raises
    ------
    UserError
        when the packet format can't represent this LiDAR.
    """

    def __init__(self, spec: Lidar, profile: packets.Profile) -> None:
        require(spec, "an Ouster device", "os1_64.yaml", _conditions(spec, profile))
        self._profile = profile
        self._identity = _INITIALIZATION_ID, zlib.crc32(spec.name.encode())
        lasers = len(spec.elevations_deg)
        from_the_highest = np.arange(lasers)[::-1]
        pixels = partial(packets.pixels, profile)
        self._stream = TurningStream(spec, packets.COLUMNS, from_the_highest, pixels)
        self.calibration = json.dumps(_metadata(spec, profile, self._identity), indent=2)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        _, first, measured, start_nanos = self._stream.take(cloud, epoch_nanos)
        schedule, later = self._stream.schedule, np.arange(len(measured))
        later_nanos = (later * (NANOS / float(schedule.rate_hz))).astype(np.int64)
        made = packets.lidar_packets(
            *(self._profile, measured[:, 0], first + later),
            *(self._stream.turn, start_nanos + schedule.nanos(first) + later_nanos, self._identity),
        )
        return [Datagram(packet) for packet in made]


def _metadata(spec: Lidar, profile: packets.Profile, identity: tuple[int, int]) -> object:
    """Return the metadata of a device, as it answers to `GET /api/v1/sensor/metadata`.

    Beams start at the origin of the sensor's frame, as those of the model do.
    """
    columns, lasers = spec.firings_per_revolution, len(spec.elevations_deg)
    azimuths_deg = (spec.azimuth_offsets_deg or (0.0,) * lasers)[::-1]
    view_deg = spec.elevations_deg[-1] - spec.elevations_deg[0]
    line = min(_FIELDS_OF_VIEW_DEG, key=lambda line: abs(_FIELDS_OF_VIEW_DEG[line] - view_deg))
    return {
        "sensor_info": {
            "prod_line": f"{line}-{lasers}",
            "prod_sn": str(identity[1]),
            "initialization_id": identity[0],
            "image_rev": "ousteros-image-groundlink-v2.5.0",
            "build_rev": "v2.5.0",
            "status": "RUNNING",
        },
        "config_params": {
            "azimuth_window": [0, 360000],
            "columns_per_packet": packets.COLUMNS,
            "lidar_mode": MODES[columns, round(spec.rotation_rate_hz)],
            "operating_mode": "NORMAL",
            "timestamp_mode": "TIME_FROM_PTP_1588",
            "udp_profile_imu": "LEGACY",
            "udp_profile_lidar": profile.name,
        },
        "lidar_data_format": {
            "column_window": [0, columns - 1],
            "columns_per_frame": columns,
            "columns_per_packet": packets.COLUMNS,
            "fps": round(spec.rotation_rate_hz),
            "pixel_shift_by_row": [round(angle * columns / 360) for angle in azimuths_deg],
            "pixels_per_column": lasers,
            "udp_profile_imu": "LEGACY",
            "udp_profile_lidar": profile.name,
        },
        "beam_intrinsics": {
            "beam_altitude_angles": spec.elevations_deg[::-1],
            "beam_azimuth_angles": azimuths_deg,
            # A float: instead of the integer 0 decoders take the device's typical value.
            "lidar_origin_to_beam_origin_mm": 0.0,
        },
        "lidar_intrinsics": {"lidar_to_sensor_transform": _HALF_TURN},
        "imu_intrinsics": {"imu_to_sensor_transform": np.eye(4).ravel().tolist()},
        "calibration_status": {"reflectivity": {"valid": True, "timestamp": ""}},
    }


def _conditions(spec: Lidar, profile: packets.Profile) -> dict[str, bool]:
    """Return the conditions for being compatible with Ouster's decoders."""
    turn = spec.rotation, spec.start_deg % 360, spec.field_of_view_deg
    mode = spec.firings_per_revolution, spec.rotation_rate_hz
    max_range_m = profile.max_range_mm / 1000
    return {
        "its `elevations_deg` are not 16, 32, 64 or 128": len(spec.elevations_deg) in LASERS,
        "by `firings_per_revolution` and `rotation_rate_hz` it has none of the modes "
        f"{', '.join(MODES.values())}": mode in MODES,
        "it does not turn clockwise, all round, from 180 degrees on (`rotation`, `start_deg`, "
        "`field_of_view_deg`)": turn == ("clockwise", 180, 360),
        "its lasers do not fire at once (`laser_times_us`)": not any(spec.laser_times_us),
        "it has `vertical_offsets_m`": not any(spec.vertical_offsets_m),
        "it has an `azimuth_resolution_deg`": not spec.azimuth_resolution_deg,
        f"its `returns` are `{spec.returns}`, not `strongest`": spec.returns == "strongest",
        "it has a `mirror`": spec.mirror is None,
        f"its `max_range_m` is above {max_range_m:g}": spec.max_range_m <= max_range_m,
    }
