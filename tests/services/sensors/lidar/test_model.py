# SPDX-License-Identifier: Apache-2.0
"""What a LiDAR makes of states besides geometry: stamps, layout, noise, and its bits."""

from typing import Any

import msgspec
import numpy as np
import pytest
from scipy import stats

from groundlink.messages.base import POINT, BadBusMessage
from groundlink.scenario.every_sensor import Carrier
from services.sensors.lidar.spec import Lidar

from . import rooms

NOISY = {"range_stddev_m": 0.03, "laser_bias_m": 0.02, "range_resolution_m": 0.002, "dropout": 0.1}


def ranges(**lidar: Any) -> np.ndarray:
    """Ranges of a sensor at rest, shape (firings, 16); every ray of it returns."""
    lidar = {"firings_per_revolution": 1800, **lidar}
    (cloud,) = rooms.clouds(rooms.scenario(**lidar), rooms.at_rest, 41)
    return np.linalg.norm(rooms.points(cloud), axis=1).reshape(-1, 16)


def test_stamps_frames_and_layout() -> None:
    made = rooms.scenario()
    seen = rooms.clouds(made, rooms.at_rest, 121, first_tick=17)
    assert [cloud.stamp_nanos - rooms.EPOCH_NANOS for cloud in seen] == [100_000_000, 200_000_000]
    for cloud in seen:
        assert cloud.frame == "rover/lidar_link"
        assert POINT.itemsize == 22
        assert len(cloud.points) == 22 * 360 * 16
        assert cloud.records()["time"][0] == 0.0
        np.testing.assert_array_equal(
            cloud.records()["ring"].reshape(-1, 16), [list(range(16))] * 360
        )


def test_a_cloud_comes_with_the_state_at_its_end() -> None:
    made = rooms.scenario()
    model = rooms.model(made)
    assert model.settled_tick() == -1
    settled = {}
    for state in rooms.states(made, rooms.at_rest, 110, first_tick=30):
        settled[state.tick] = (len(model.readings(state)), model.settled_tick())
    assert [tick for tick, (clouds, _) in settled.items() if clouds] == [80, 120]
    assert settled[30] == (0, 30)
    assert settled[79] == (0, 40)
    assert settled[80] == (1, 80)
    assert settled[139] == (0, 120)


def test_a_cloud_of_another_rate_waits_for_the_state_after_its_end() -> None:
    made = rooms.scenario(rotation_rate_hz=15.0)
    model = rooms.model(made)
    came = [
        (state.tick, cloud.stamp_nanos - rooms.EPOCH_NANOS, model.settled_tick())
        for state in rooms.states(made, rooms.at_rest, 82)
        for cloud in model.readings(state)
    ]
    # A revolution takes 26 2/3 ticks.
    assert came == [(27, 0, 26), (54, 66_666_666, 53), (80, 133_333_333, 80)]


def test_the_layout_in_ros_changes_no_point() -> None:
    plain, ouster = (
        rooms.clouds(rooms.scenario(**fields), rooms.at_rest, 41)[0]
        for fields in ({}, {"cloud_layout": "ouster"})
    )
    assert (plain.layout, ouster.layout) == ("velodyne", "ouster")
    assert plain.points == ouster.points
    spec = rooms.scenario(cloud_layout="ouster").vehicles[0].sensors[0]
    assert isinstance(spec, Lidar)
    largest = spec.largest_message(Carrier("", "base_link", ()))
    assert (largest.layout, len(largest.records())) == ("ouster", 16 * 360)


def test_noise_has_the_data_sheets_sigma() -> None:
    error = ranges(range_stddev_m=0.03) - ranges()
    count = error.size
    assert abs(error.mean()) < 4 * 0.03 / np.sqrt(count)
    # Chi-square at five sigma of its own spread, to both sides.
    assert abs(np.sum((error / 0.03) ** 2) - count) < 5 * np.sqrt(2 * count)
    assert stats.kstest(error.ravel() / 0.03, "norm").pvalue > 1e-3
    # Neighbors in either direction know nothing of each other.
    for a, b in ((error[1:], error[:-1]), (error[:, 1:], error[:, :-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 5 / np.sqrt(count)


def test_noise_is_new_in_each_revolution() -> None:
    made = rooms.scenario(range_stddev_m=0.03)
    first, second = (rooms.points(c) for c in rooms.clouds(made, rooms.at_rest, 81))
    assert np.abs(first - second).max() > 0.05


def test_bias_is_a_lasers_own_and_stays() -> None:
    made, exact = rooms.scenario(laser_bias_m=0.02), rooms.scenario()
    first, second = (rooms.points(c) for c in rooms.clouds(made, rooms.at_rest, 81))
    np.testing.assert_array_equal(first, second)
    (true,) = rooms.clouds(exact, rooms.at_rest, 41)
    error = np.linalg.norm(first, axis=1) - np.linalg.norm(rooms.points(true), axis=1)
    of_laser = error.reshape(-1, 16)
    assert np.ptp(of_laser, axis=0).max() < 1e-5
    assert 0.005 < np.abs(of_laser).max() <= 0.02 + 1e-5
    assert len(set(np.round(of_laser[0], 5))) == 16


def test_bias_stays_with_the_laser_whatever_the_order_of_firing() -> None:
    def biases(**lidar: Any) -> dict[int, float]:
        cloud = rooms.clouds(rooms.scenario(laser_bias_m=0.02, **lidar), rooms.at_rest, 41)[0]
        true = rooms.clouds(rooms.scenario(**lidar), rooms.at_rest, 41)[0]
        error = np.linalg.norm(rooms.points(cloud), axis=1)
        error -= np.linalg.norm(rooms.points(true), axis=1)
        return dict(zip(cloud.records()["ring"].tolist(), error.round(4).tolist(), strict=True))

    assert biases() == biases(laser_times_us=[2.0 * (15 - k) for k in range(16)])


def test_ranges_are_multiples_of_the_resolution() -> None:
    exact, rounded = ranges(), ranges(range_resolution_m=0.05)
    np.testing.assert_allclose(rounded / 0.05, np.rint(exact / 0.05), atol=1e-3)
    noisy = ranges(range_resolution_m=0.05, range_stddev_m=0.03, laser_bias_m=0.02)
    np.testing.assert_allclose(noisy / 0.05, np.rint(noisy / 0.05), atol=1e-3)
    assert np.any(np.abs(noisy - rounded) > 0.01)


def test_dropout_is_a_share_of_the_returns() -> None:
    (all_of_them,) = rooms.clouds(rooms.scenario(), rooms.at_rest, 41)
    (left,) = rooms.clouds(rooms.scenario(dropout=0.1), rooms.at_rest, 41)
    count = len(all_of_them.records())
    lost = count - len(left.records())
    assert abs(lost - 0.1 * count) < 5 * np.sqrt(count * 0.1 * 0.9)
    assert set(map(bytes, left.records())) < set(map(bytes, all_of_them.records()))
    assert not rooms.clouds(rooms.scenario(dropout=1.0), rooms.at_rest, 41)[0].records().size


def test_noise_of_a_ray_does_not_depend_on_what_others_meet() -> None:
    pillar = {
        "name": "pillar",
        "shape": {"kind": "cylinder", "radius_m": 0.5, "length_m": 3.0},
        "material": "dark",
        "position_m": [-2.0, 1.0, 1.5],
    }
    views = [
        rooms.clouds(rooms.scenario(solids=solids, max_range_m=5.0, **NOISY), rooms.at_rest, 41)
        for solids in ((), (pillar,))
    ]
    bare, with_pillar = (set(map(bytes, cloud.records())) for (cloud,) in views)
    # All but the rays that meet it are the same to the bit.
    assert 0.02 < len(bare - with_pillar) / len(bare) < 0.2


def test_a_cloud_outlives_the_next() -> None:
    """Memory is used again from revolution to revolution, but not what was handed out."""
    made = rooms.scenario(range_stddev_m=0.03)
    model = rooms.model(made)
    kept: list[Any] = []
    for state in rooms.states(made, rooms.at_rest, 41):
        kept += model.readings(state)
    before = bytes(kept[0].points)
    for state in rooms.states(made, rooms.at_rest, 120, first_tick=41):
        model.readings(state)
    assert bytes(kept[0].points) == before


def test_a_state_that_lacks_links_restarts_the_model() -> None:
    made = rooms.scenario()
    model = rooms.model(made)
    seen = []
    for state in rooms.states(made, rooms.at_rest, 121):
        if state.tick == 20:
            (broken,) = rooms.states(made, rooms.at_rest, 1, first_tick=20, links=2)
            with pytest.raises(BadBusMessage):
                model.readings(broken)
        else:
            seen += model.readings(state)
    assert [c.stamp_nanos - rooms.EPOCH_NANOS for c in seen] == [100_000_000, 200_000_000]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"elevations_deg": []}, "`elevations_deg` is empty"),
        *(
            ({field: [0.0, 1.0, 2.0]}, f"`{field}` has 3 values, but `elevations_deg` has 16")
            for field in (
                *("azimuth_offsets_deg", "laser_stddevs_m"),
                *("laser_times_us", "vertical_offsets_m"),
            )
        ),
        ({"min_range_m": 5.0, "max_range_m": 4.0}, "`min_range_m` is 5; expected less than"),
        ({"rays_per_beam": 8, "divergence_mrad": [3.0, 1.5]}, "is 8; expected a square"),
        ({"firings_per_azimuth": 7}, "is 360; expected a multiple of `firings_per_azimuth`, 7"),
        ({"rays_per_beam": 16}, "`rays_per_beam` is 16, but `divergence_mrad` is zero"),
        ({"field_of_view_deg": 270.0, "block_deg": 100.0}, "expected 0 or 270 divided by"),
        ({"returns": "first"}, "Invalid enum value 'first'"),
    ],
)
def test_conflicting_fields_give_one_line(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        rooms.scenario(**fields)
