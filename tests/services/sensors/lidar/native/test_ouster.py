# SPDX-License-Identifier: Apache-2.0
"""Clouds as an Ouster device's packets: what ouster-sdk decodes from them by their metadata."""

import json
from typing import Any

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.messages.base import PointCloud
from services.sensors.lidar.native import FORMATS
from tests.services.sensors.lidar import rooms

from .test_vlp16 import POLES, WAY, sheet, spec

LEGACY, RNG = "ouster_legacy", "ouster_rng19_rfl8_sig16_nir16"
MODES = [(512, 10), (1024, 20), (2048, 10)]


def sent(fields: dict[str, Any], clouds: list[PointCloud]) -> list[bytes]:
    """Return the payloads that a fresh device makes of clouds."""
    device = FORMATS[fields["native_format"]](spec(**fields))
    made = [one for cloud in clouds for one in device.datagrams(cloud, rooms.EPOCH_NANOS)]
    assert {one.port for one in made} <= {None}
    return [one.payload for one in made]


@pytest.mark.parametrize("block_deg", [0.0, 22.5])
@pytest.mark.parametrize(("columns", "rate_hz"), MODES)
@pytest.mark.parametrize("native_format", [LEGACY, RNG])
def test_ouster_sdk_decodes_the_points_of_the_clouds(
    native_format: str, columns: int, rate_hz: int, block_deg: float
) -> None:
    """Ranges to the millimeter, instants to the nanosecond, frame by frame."""
    sdk = pytest.importorskip("ouster.sdk.core")
    turn = {"rotation_rate_hz": rate_hz, "firings_per_revolution": columns}
    fields = sheet("os1_64", native_format=native_format, block_deg=block_deg, **turn)
    clouds = rooms.clouds(rooms.scenario(solids=POLES, **fields), WAY, 2 * 400 // rate_hz + 1)
    payloads = sent(fields, clouds)
    assert len(payloads) == 2 * columns // 16

    info = sdk.SensorInfo(FORMATS[native_format](spec(**fields)).calibration)
    form, batch, scan = sdk.PacketFormat(info), sdk.ScanBatcher(info), sdk.LidarScan(info)
    scans = []
    for payload in payloads:
        packet = sdk.LidarPacket(len(payload))
        packet.buf[:], packet.format = np.frombuffer(payload, np.uint8), form
        packet.host_timestamp = 1
        assert packet.validate(info) == sdk.PacketValidationFailure.NONE
        assert packet.crc() == (None if native_format == LEGACY else packet.calculate_crc())
        if batch(packet, scan):
            scans.append(scan)
            scan = sdk.LidarScan(info)
    assert [scan.frame_id for scan in scans] == [0, 1]

    to_points, per_frame = sdk.XYZLut(info), len(clouds) // 2
    for number, scan in enumerate(scans):
        start = rooms.EPOCH_NANOS + number * 10**9 // rate_hz
        assert (
            np.abs(scan.timestamp - start - np.arange(columns) * 1e9 / rate_hz / columns).max() < 2
        )
        np.testing.assert_array_equal(scan.measurement_id, np.arange(columns))
        assert scan.complete()
        of_frame = clouds[number * per_frame : (number + 1) * per_frame]
        ours = np.concatenate([cloud.records() for cloud in of_frame])
        seconds = np.concatenate([rooms.sim_seconds(cloud) for cloud in of_frame])
        column = np.rint((seconds - number / rate_hz) * rate_hz * columns).astype(int)
        row = 63 - ours["ring"]
        assert np.count_nonzero(scan.field("RANGE")) == len(ours) > 0.5 * 64 * columns
        reflectivity = scan.field("REFLECTIVITY")[row, column]
        np.testing.assert_array_equal(reflectivity, np.rint(ours["intensity"]))
        theirs = to_points(scan)[row, column]
        expected = np.stack([ours[axis] for axis in "xyz"], -1)
        assert np.abs(theirs - expected).max() < 1e-5


def test_a_packet_does_not_depend_on_the_messages() -> None:
    whole = sheet("os1_64", native_format=RNG)
    blocks = whole | {"block_deg": 2.5}
    a, b = (rooms.clouds(rooms.scenario(**fields), WAY, 81) for fields in (whole, blocks))
    assert len(b) == 144 * len(a)
    assert sent(whole, a) == sent(blocks, b)
    # A packet with a missing column is not sent.
    assert sent(whole, [a[1]]) == sent(blocks, b[144:]) == sent(whole, a)[64:]
    assert sent(blocks, b[:1] + b[2:]) == sent(whole, a)[1:]


def test_the_metadata_has_the_angles_from_the_highest_beam_down() -> None:
    fields = sheet("os1_64")
    metadata = json.loads(FORMATS[LEGACY](spec(**fields)).calibration)
    beams = metadata["beam_intrinsics"]
    assert beams["beam_altitude_angles"][:2] == [16.611, 16.084]
    assert beams["beam_azimuth_angles"][:4] == [3.164, 1.055, -1.055, -3.164]
    assert metadata["lidar_data_format"]["pixel_shift_by_row"][:4] == [9, 3, -3, -9]
    assert metadata["sensor_info"]["prod_line"] == "OS-1-64"
    assert metadata["config_params"]["lidar_mode"] == "1024x10"


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"rotation_rate_hz": 5.0}, "none of the modes 512x10"),
        ({"firings_per_revolution": 1000}, "none of the modes"),
        ({"elevations_deg": [0.0] * 40, "azimuth_offsets_deg": []}, "not 16, 32, 64 or 128"),
        ({"start_deg": 0.0}, "from 180 degrees on"),
        ({"rotation": "counterclockwise"}, "does not turn clockwise"),
        ({"laser_times_us": [1.0] * 64}, "do not fire at once"),
        ({"vertical_offsets_m": [0.01] * 64}, "`vertical_offsets_m`"),
        ({"azimuth_resolution_deg": 0.01}, "`azimuth_resolution_deg`"),
        ({"returns": "last"}, "`last`, not `strongest`"),
        ({"native_format": RNG, "max_range_m": 600.0}, "above 524.287"),
    ],
)
def test_specs_without_ouster_packets_are_refused(changed: dict[str, Any], reason: str) -> None:
    lidar = spec(**sheet("os1_64") | changed)
    with pytest.raises(UserError, match="not an Ouster device") as refused:
        FORMATS[lidar.native_format](lidar)
    assert reason in str(refused.value)
    assert "os1_64.yaml" in str(refused.value)
