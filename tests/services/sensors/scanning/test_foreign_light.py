# SPDX-License-Identifier: Apache-2.0
"""Sunlight and pulses of other LiDARs do what the formulas say, and nothing where they are off."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from groundlink.scenario.schema import Scenario
from groundlink.world.solids import Solid
from groundlink.world.weather import Lamps, Sun
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.foreign_light import ForeignLight, threshold
from services.sensors.scanning.returns import Returns
from tests.services.sensors.sheets import from_sheet

from . import targets

SHARE, FALSE = 0.7, 1e-3
SUN = {"reach_share": SHARE, "false_share": FALSE}
DEVICE: dict[str, Any] = {"full_range_reflectivity": 0.5, "max_range_m": 100.0}
K = (SHARE**-4 - 1) / 0.5
BEHIND = Sun(azimuth_deg=270.0, elevation_deg=5.0)
"""Behind the sensor, so that it shines on what the sensor looks at."""

AHEAD = Sun(azimuth_deg=90.0, elevation_deg=5.0)
LAMPS = Lamps(at_m=((0.0, 0.0, 5.0),))
COS = math.cos(math.radians(5))
PLACE = {"name": "a", "topic": "/a", "frame": "a", "elevations_deg": [0.0]}


def scene(*solids: Solid, light: Sun | Lamps = BEHIND, lidars: int = 1, **spec: Any) -> Scenario:
    """Return a scenario with a light and further LiDARs on the vehicle."""
    made = targets.scenario(*solids, **DEVICE | spec)
    vehicle = made.vehicles[0]
    own = vehicle.sensors[0]
    others = tuple(replace(own, name=f"other{i}") for i in range(lidars - 1))
    return replace(
        made,
        world=replace(made.world, light=light),
        vehicles=(replace(vehicle, sensors=(own, *others)), *made.vehicles[1:]),
    )


def measured(*solids: Solid, **given: Any) -> Returns:
    return targets.measured(scene(*solids, **given))


def is_seen(material: str, distance_m: float, **given: Any) -> bool:
    """Return whether the middle of a wall is detected, whatever noise adds."""
    made = measured(targets.wall(material, distance_m), **given)
    middle = made.label[0, 0, 400:600]
    return bool((middle >= 0).mean() > 0.9)


@pytest.mark.parametrize(
    ("material", "reflectivity", "light", "glare_deg", "background"),
    [
        ("white", 1.0, BEHIND, 0.0, COS),
        ("gray", 0.5, BEHIND, 0.0, 0.5 * COS),
        ("dark", 0.1, BEHIND, 0.0, 0.1 * COS),
        # The seen side is in shade.
        ("gray", 0.5, AHEAD, 0.0, 0.0),
        # 5 degrees from the sun, where scattered light is that of a white surface.
        ("gray", 0.5, AHEAD, 5.0, 1.0),
        ("gray", 0.5, AHEAD, 2.5, 0.25),
        # Away from the sun, the optics scatter hardly anything.
        ("gray", 0.5, BEHIND, 5.0, 0.5 * COS),
        ("gray", 0.5, LAMPS, 5.0, 0.0),
    ],
)
def test_reach_falls_with_the_background(
    material: str, reflectivity: float, light: Sun | Lamps, glare_deg: float, background: float
) -> None:
    given = {"light": light, "sun": SUN | {"glare_deg": glare_deg}}
    given |= {"max_range_m": 140.0, "full_range_reflectivity": 0.98}
    k = (SHARE**-4 - 1) / 0.98
    reach_m = 140 * math.sqrt(reflectivity / 0.98 / math.sqrt(1 + k * background))
    assert is_seen(material, min(0.99 * reach_m, 139.0), **given)
    assert reach_m > 138 or not is_seen(material, 1.01 * reach_m, **given)


def test_full_sunlight_leaves_the_stated_share_of_the_range() -> None:
    assert is_seen("gray", 99.0, light=LAMPS, sun=SUN)
    for distance_m, expected in ((69.5, True), (71.5, False)):
        assert is_seen("gray", distance_m, sun=SUN) == expected


def test_the_avias_ranges_in_sunlight_are_those_of_its_manual() -> None:
    """450 m on 80 % in the dark are 320 m in the sun; on 20 %, 260 m in the dark are 230 m.

    Figures of the manual as commonly quoted.
    """
    spec = from_sheet(Lidar, "avia")
    assert spec.sun is not None
    noise = (spec.sun.reach_share**-4 - 1) / spec.full_range_reflectivity
    for reflectivity, dark_m, sunny_m in ((0.8, 450, 320), (0.2, 260, 230)):
        found = (1 + noise * reflectivity) ** -0.25
        assert found == pytest.approx(sunny_m / dark_m, rel=0.02)


def test_sunlight_makes_ranges_noisier() -> None:
    near_m = 30.0
    spec = msgspec.convert({**PLACE, **DEVICE, "sun": SUN}, Lidar)
    least, power = 0.5 / 100**2, 1 / near_m**2
    sigma_m = spec.cell_m / math.sqrt(2) * math.sqrt(K * COS) * least / power
    sigma_m /= threshold(spec, FALSE)
    # A narrow view, so that all rays meet the wall straight on.
    narrow = {"field_of_view_deg": 1.0, "start_deg": 0.5, "elevations_deg": [0.0] * 40}
    for own_m in (0.0, 0.005):
        made = measured(
            targets.wall("white", near_m), sun=SUN, range_stddev_m=own_m, lidars=1, **narrow
        )
        on_wall = made.returned & (made.label >= 0)
        errors = (made.range_m - made.true_range_m)[on_wall]
        assert len(errors) > 4_000
        assert errors.std() == pytest.approx(math.hypot(own_m, sigma_m), rel=0.05)
        assert abs(errors.mean()) < 5 * sigma_m / math.sqrt(len(errors)) + 1e-4


def test_noise_alone_returns_in_the_stated_share_of_shots_at_any_range() -> None:
    many = {"elevations_deg": [0.0] * 100, "min_range_m": 2.0}
    made = measured(sun=SUN, **many)
    false = made.returned & (made.label < 0)
    assert false.sum() == made.returned.sum()
    shots = false.size
    assert false.sum() == pytest.approx(shots * FALSE, abs=5 * math.sqrt(shots * FALSE))
    span = stats.uniform(2.0, 98.0)
    assert stats.kstest(made.true_range_m[false], span.cdf).pvalue > 1e-3
    # Their power is that of the threshold.
    power = made.intensity[false] / made.true_range_m[false] ** 2
    assert np.median(power) == pytest.approx(0.5 / 100**2 * 100, rel=0.05)
    assert not measured(light=LAMPS, sun=SUN, **many).returned.any()


def test_the_threshold_is_that_of_rice() -> None:
    """By noise of a band of 1 / (2 tau), sampled finely: upward crossings of a level."""
    spec = from_sheet(Lidar, "vlp16")
    gate_s = 2 * (spec.max_range_m - spec.min_range_m) / 299_792_458
    for share in (1e-4, 0.05):
        level = threshold(spec, share)
        rate = math.exp(-(level**2) / 2) / (2 * math.sqrt(3) * spec.pulse_length_ns * 1e-9)
        assert 1 - math.exp(-rate * gate_s) == pytest.approx(share, rel=1e-6)
    source = np.random.default_rng(1)
    tau, steps, level = 16, 2**20, 2.5
    spectrum = np.fft.rfft(source.standard_normal(steps))
    spectrum[np.fft.rfftfreq(steps) > 1 / (2 * tau)] = 0
    noise = np.fft.irfft(spectrum)
    noise /= noise.std()
    crossings = np.count_nonzero((noise[1:] > level) & (noise[:-1] <= level)) / steps
    expected = math.exp(-(level**2) / 2) / (2 * math.sqrt(3) * tau)
    assert crossings == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("mode", ["strongest", "last"])
@pytest.mark.parametrize("lidars", [1, 2, 4])
def test_pulses_of_others_fall_into_a_share_of_shots(mode: str, lidars: int) -> None:
    share, wall_m = 0.01, 40.0
    fields = {"elevations_deg": [0.0] * 40, "returns": mode, "crosstalk_share": share}
    wall = targets.wall("gray", wall_m)
    made = measured(wall, light=LAMPS, lidars=lidars, **fields)
    false = made.returned & (made.label < 0)
    # A pulse wins if it is brighter than the wall, or behind it and above the threshold.
    faint = 0.5 / 100**2 / (0.5 / wall_m**2) / 2
    wins = 0.5 if mode == "strongest" else 0.6 * (1 - faint)
    expected = (1 - (1 - share) ** (lidars - 1)) * wins
    shots = false.size
    assert false.mean() == pytest.approx(expected, abs=5 * math.sqrt(expected / shots) + 1e-9)
    if lidars > 1:
        begin = 0.0 if mode == "strongest" else wall_m
        inside = made.true_range_m[false]
        assert stats.kstest(inside, stats.uniform(begin, 100 - begin).cdf).pvalue > 1e-3


def test_others_are_not_seen_where_nothing_is_met() -> None:
    made = measured(light=LAMPS, lidars=3, crosstalk_share=0.5)
    assert not made.returned.any()


def test_false_returns_depend_on_tick_and_ray_only() -> None:
    """A firing has the same ones in whatever block it is; another revolution has others."""
    fields = {"sun": SUN | {"false_share": 0.02}, "crosstalk_share": 0.02, "lidars": 2}
    sensor = targets.scanner(scene(targets.wall("gray", 20.0), **fields))
    for state in targets.rooms.states(scene(**fields), targets.at_rest, 82):
        sensor.replica.take(state)
    whole = sensor.measure(0, range(1001)).returns
    again = sensor.measure(1, range(1001)).returns
    parts = [sensor.measure(0, firings).returns for firings in (range(300), range(300, 1001))]
    for field in ("range_m", "returned", "label", "intensity"):
        joined = np.concatenate([getattr(part, field) for part in parts], axis=-1)
        np.testing.assert_array_equal(joined, getattr(whole, field))
    assert (whole.label != again.label).any()


def test_what_is_off_changes_no_bit() -> None:
    wall = targets.wall("gray", 50.0)
    noisy = {"range_stddev_m": 0.02, "dropout": 0.1}
    plain = measured(wall, light=LAMPS, **noisy)
    for given in (
        {"light": BEHIND},
        {"light": LAMPS, "sun": SUN | {"glare_deg": 10.0}},
        {"light": LAMPS, "crosstalk_share": 0.5},
    ):
        other = measured(wall, **noisy, **given)
        for field, expected in plain._asdict().items():
            np.testing.assert_array_equal(getattr(other, field), expected)


def test_beams_of_many_rays_have_the_mean_background() -> None:
    """Half of each beam on a lit wall, half in the sky: half of the background."""
    low = targets.box("gray", (60.5, 0, -50), (1, 400, 100))
    beam = {"divergence_mrad": [1.0, 1.0], "rays_per_beam": 4, "elevations_deg": [0.0]}
    for share, expected in ((0.8, True), (0.55, False)):
        made = measured(low, sun=SUN | {"reach_share": share}, **beam)
        # Half of the light: 70.7 m in the dark.
        k = (share**-4 - 1) / 0.5
        reach_m = 100 * math.sqrt(0.5 / math.sqrt(1 + k * 0.25 * COS))
        assert (reach_m > 60.5) == expected
        assert bool(((made.label >= 0).mean()) > 0.9) == expected


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"sun": SUN}, "`sun` needs a threshold of detection"),
        ({"sun": SUN | {"reach_share": 1.0}, **DEVICE}, "reach_share"),
        ({"sun": SUN | {"false_share": 0.0}, **DEVICE}, "false_share"),
        ({"crosstalk_share": 1.5}, "crosstalk_share"),
    ],
)
def test_contradictions_are_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=reason):
        msgspec.convert({**PLACE, **fields}, Lidar)


def test_without_other_lidars_or_sun_there_is_nothing_to_draw() -> None:
    spec = replace(from_sheet(Lidar, "avia"), crosstalk_share=0.1)
    assert ForeignLight(spec, None, 0).share == 0
    assert ForeignLight(spec, None, 2).share == pytest.approx(0.19)
    assert ForeignLight(spec, None, 2).sunlight is None
