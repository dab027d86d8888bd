# SPDX-License-Identifier: Apache-2.0
"""Clouds as a VLP-16's packets: what others decode from them, and which packets there are."""

import math
import struct
from typing import Any

import numpy as np
import pytest
import yaml
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import PointCloud
from groundlink.scenario.schema import Scenario
from services.sensors.lidar.native.vlp16 import LASER_OF_RING, Vlp16
from services.sensors.lidar.spec import Lidar
from tests.services.sensors.lidar import rooms

WAY = rooms.driving(speed_mps=1.0, turn_radps=0.5)
# A pole that takes a part of many beams, before a wall.
POLES = [
    {
        "name": f"pole{i}",
        "shape": {"kind": "cylinder", "radius_m": 0.004, "length_m": 3.0},
        "material": "dark",
        "position_m": [2.0 * math.cos(angle), 2.0 * math.sin(angle), 1.5],
    }
    for i, angle in enumerate(np.arange(0.0, math.tau, 0.2).tolist())
]
RATES = [(5.0, 3616), (10.0, 1808), (20.0, 904)]
"""Revolutions a second that a VLP-16 can be set to, with the firings of one."""

BEAM = {"divergence_mrad": [3.0, 1.5], "rays_per_beam": 16}


def sheet(name: str = "vlp16", **changed: Any) -> dict[str, Any]:
    """Return a shipped data sheet's fields."""
    fields = yaml.safe_load((SHIPPED / "sensors" / f"{name}.yaml").read_text())
    return {k: v for k, v in fields.items() if k not in ("kind", "datasheet")} | changed


def spec(**fields: Any) -> Lidar:
    made = rooms.scenario(**fields).vehicles[0].sensors[0]
    assert isinstance(made, Lidar)
    return made


def clouds(made: Scenario, ticks: int = 81) -> list[PointCloud]:
    return rooms.clouds(made, WAY, ticks)


def sent(lidar: Lidar, seen: list[PointCloud]) -> list[tuple[int | None, bytes]]:
    """Return ports and payloads that a fresh device makes of clouds."""
    device = Vlp16(lidar)
    return [
        (port, payload)
        for cloud in seen
        for payload, port in device.datagrams(cloud, rooms.EPOCH_NANOS)
    ]


def data(lidar: Lidar, seen: list[PointCloud]) -> list[bytes]:
    return [payload for port, payload in sent(lidar, seen) if port is None]


def decoded(lidar: Lidar, packets: list[bytes]) -> np.ndarray:
    """Return the points that velodyne-decoder finds, `time` in seconds of sim time."""
    decoder = pytest.importorskip("velodyne_decoder")
    lasers = [
        {
            "laser_id": int(LASER_OF_RING[ring]),
            "rot_correction": 0.0,
            "vert_correction": float(np.radians(lidar.elevations_deg[ring])),
            "vert_offset_correction": lidar.vertical_offsets_m[ring],
        }
        for ring in range(16)
    ]
    calibration = {"distance_resolution": 0.002, "lasers": lasers, "num_lasers": 16}
    config = decoder.Config(
        model=decoder.Model.VLP16,
        calibration=decoder.Calibration.from_string(yaml.safe_dump(calibration)),
    )
    found = []
    for packet in packets:
        # By itself each, so that times come in float32 of small numbers.
        host = decoder.VelodynePacket(rooms.EPOCH_NANOS * 1e-9, packet)
        _, points = decoder.ScanDecoder(config).decode([host], as_pcl_structs=True)
        (micros,) = struct.unpack_from("<I", packet, 1200)
        hour_micros = rooms.EPOCH_NANOS // 1000 % 3_600_000_000
        points = points.astype([(n, "f8") for n in points.dtype.names])
        points["time"] += (micros - hour_micros) * 1e-6
        found.append(points)
    return np.concatenate(found)


def polar(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return range in meters, azimuth and elevation in degrees."""
    across = np.hypot(x, y)
    return np.hypot(across, z), np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, across))


@pytest.mark.parametrize("block_deg", [0.0, 15.0])
@pytest.mark.parametrize("returns", ["strongest", "last", "dual"])
@pytest.mark.parametrize(("rate_hz", "firings"), RATES)
def test_others_decode_the_points_of_the_clouds(
    rate_hz: float, firings: int, returns: str, block_deg: float
) -> None:
    """As close as the form can tell: 2 mm, and 0.01 degrees, to which decoders round.

    Three revolutions are a whole number of packets: later ones begin at the same azimuths.
    """
    turn = {"rotation_rate_hz": rate_hz, "firings_per_revolution": firings}
    beam = BEAM if returns == "dual" else {}
    fields = sheet(returns=returns, block_deg=block_deg, min_range_m=0.0, **turn, **beam)
    made = rooms.scenario(solids=POLES, **fields)
    lidar = made.vehicles[0].sensors[0]
    assert isinstance(lidar, Lidar)
    seen = clouds(made, round(3 * 400 / rate_hz) + 1)
    found = decoded(lidar, data(lidar, seen))
    ours = np.concatenate([cloud.records() for cloud in seen])
    seconds = np.concatenate([rooms.sim_seconds(cloud) for cloud in seen])
    assert len(found) == len(ours) >= 3 * firings * 16

    np.testing.assert_array_equal(found["ring"], ours["ring"])
    np.testing.assert_allclose(found["time"], seconds, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(found["intensity"], np.rint(ours["intensity"]))
    height = np.array(lidar.vertical_offsets_m)[ours["ring"]]
    theirs = polar(found["x"], found["y"], found["z"] - height)
    expected = polar(*(ours[axis].astype(np.float64) for axis in "xy"), ours["z"] - height)
    assert np.abs(theirs[0] - expected[0]).max() < 1e-4
    off_deg = (theirs[1] - expected[1] + 180) % 360 - 180
    assert np.abs(off_deg).max() < 0.01
    assert np.abs(theirs[2] - expected[2]).max() < 1e-4
    kinds = {"strongest": {1}, "last": {2}, "dual": {1, 2, 3}}
    assert set(found["return_type"].astype(int)) == kinds[returns]


@pytest.fixture(scope="module")
def three() -> list[PointCloud]:
    """Three revolutions."""
    return clouds(rooms.scenario(**sheet()), 121)


def test_packets_do_not_depend_on_the_messages(three: list[PointCloud]) -> None:
    whole = sent(spec(**sheet()), three)
    # 5424 firings are 226 packets.
    assert [len(payload) for _, payload in whole] == ([1206] * 14 + [512]) * 16 + [1206] * 2
    assert [port for port, _ in whole] == ([None] * 14 + [8308]) * 16 + [None] * 2
    for block_deg in (2.5, 15.0, 120.0):
        fields = sheet(block_deg=block_deg)
        blocks = clouds(rooms.scenario(**fields), 121)
        assert len(blocks) == 3 * 360 / block_deg
        assert sent(spec(**fields), blocks) == whole


def test_position_packets_carry_the_end_of_the_previous_data_packet(
    three: list[PointCloud],
) -> None:
    stamps = [
        struct.unpack_from("<I", payload, 1200 if port is None else 198)[0]
        for port, payload in sent(spec(**sheet()), three)
    ]
    assert np.diff(stamps[:15]) == pytest.approx(24 * 55.3097, abs=1)
    assert stamps[14] == stamps[15] == stamps[0] + round(14 * 24 * 55.3097)


def test_a_successor_sends_the_packets_that_begin_after_it(three: list[PointCloud]) -> None:
    whole = data(spec(**sheet()), three)
    # The first revolution ends 8 firings into packet 75.
    assert data(spec(**sheet()), three[1:]) == whole[76:]
    assert data(spec(**sheet()), three[2:]) == whole[151:]
    # Of blocks it may see no beginning of a packet at first.
    fields = sheet(block_deg=2.5)
    blocks = clouds(rooms.scenario(**fields), 121)
    for first in range(1, 12):
        found = data(spec(**fields), blocks[first:])
        assert found == whole[-len(found) :]
        assert len(whole) - len(found) == -(-(first * 1808 // 144) // 24)


def test_unpublished_readings_have_no_packet(three: list[PointCloud]) -> None:
    whole = data(spec(**sheet()), three)
    assert data(spec(**sheet()), [three[0], three[2]]) == whole[:75] + whole[151:]


def test_only_the_time_is_wrong_when_the_clock_is(three: list[PointCloud]) -> None:
    # Eleven revolutions are no whole number of packets.
    error_nanos = 1_134_567_000
    wrong = [
        replace(c, stamp_nanos=c.stamp_nanos + error_nanos, clock_error_nanos=error_nanos)
        for c in three
    ]
    pairs = zip(data(spec(**sheet()), three), data(spec(**sheet()), wrong), strict=True)
    for right, late in pairs:
        assert right[:1200] + right[1204:] == late[:1200] + late[1204:]
        micros = [struct.unpack_from("<I", packet, 1200)[0] for packet in (right, late)]
        assert micros[1] - micros[0] == 1_134_567


def test_a_device_that_is_stuck_sends_old_directions_at_new_times() -> None:
    fields = sheet(block_deg=15.0)
    seen = clouds(rooms.scenario(**fields), 121)
    stuck = [replace(seen[5], stamp_nanos=cloud.stamp_nanos) for cloud in seen[5:]]
    found = data(spec(**fields), [*seen[:5], *stuck])
    azimuths_deg = [struct.unpack_from("<H", packet, 2)[0] / 100 for packet in found]
    micros = [struct.unpack_from("<I", packet, 1200)[0] for packet in found]
    assert len(found) > 2 * len(seen)
    assert np.all(np.diff(micros) > 0)
    assert max(azimuths_deg) < 90
    assert min(azimuths_deg[20:]) > 74.8


def test_rays_without_return_have_no_distance(three: list[PointCloud]) -> None:
    lidar = spec(**sheet())
    nothing = [replace(cloud, points=memoryview(b"")) for cloud in three]
    for packet, empty in zip(data(lidar, three), data(lidar, nothing), strict=True):
        for block in range(12):
            at = 100 * block
            assert packet[at : at + 4] == empty[at : at + 4]
            assert not any(empty[at + 4 : at + 100])
        assert packet[1200:] == empty[1200:]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        (sheet("vlp16_paper", block_deg=0.0), "a firing takes 27.778 us, not 55.296"),
        (sheet(rotation_rate_hz=20.0), "a firing takes 27.655 us"),
        (sheet(elevations_deg=np.arange(-10.0, 10.1, 4 / 3).tolist()), "`elevations_deg`"),
        (sheet(elevations_deg=[0.0], laser_times_us=[], vertical_offsets_m=[]), "`elevations_deg`"),
        (sheet(laser_times_us=[]), "`laser_times_us`"),
        (sheet(laser_times_us=[2.304 * i for i in range(16)]), "`laser_times_us`"),
        (sheet(max_range_m=200.0), "`max_range_m` is above 131.07"),
        (sheet(rotation="counterclockwise"), "does not turn clockwise"),
        (sheet(start_deg=90.0), "does not turn clockwise, all round, from 0"),
        (sheet(field_of_view_deg=270.0), "`field_of_view_deg`"),
        (sheet(azimuth_offsets_deg=[0.0] * 15 + [1.0]), "`azimuth_offsets_deg`"),
        (sheet(azimuth_resolution_deg=0.0), "no `azimuth_resolution_deg` of 0.01"),
        (sheet(firings_per_azimuth=1), "`firings_per_azimuth: 2`"),
    ],
)
def test_specs_without_vlp16_packets_are_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(UserError, match="`lidar` has no native packets") as refused:
        Vlp16(spec(**fields))
    assert reason in str(refused.value)
    assert "vlp16.yaml" in str(refused.value)
