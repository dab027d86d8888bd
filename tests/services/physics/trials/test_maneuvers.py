# SPDX-License-Identifier: Apache-2.0
"""What a vehicle lacks, its trials show; `test_vehicles` has what the shipped ones can."""

from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.report.analysis.trials import Trial
from groundlink.scenario.vehicle import VehicleModel
from services.physics.trials.maneuvers import climb, lean, stand, stop, turn
from tests.services.physics.grounds import shipped


def rover(**drive: Any) -> VehicleModel:
    model = shipped("rover")
    return replace(model, drive=replace(model.drive, **drive))


def missed(trial: Trial) -> set[str]:
    return {figure.name for figure in trial.figures if not figure.good}


def test_weak_motors_do_not_climb() -> None:
    assert "height reached" in missed(climb(rover(max_wheel_torque_nm=3.0)))


def test_weak_brakes_take_long_to_stop() -> None:
    assert "stopping distance" in missed(stop(rover(max_acceleration_mps2=12.0)))


def test_a_wrong_track_multiplier_is_found_with_the_right_one() -> None:
    trial = turn(rover(track_multiplier=1.0))
    assert {"yaw rate", "effective over geometric track"} <= missed(trial)
    assert trial.fix == "set `track_multiplier: 1.8`, the measured one"


def test_a_vehicle_that_hardly_turns_gets_no_multiplier() -> None:
    assert turn(rover(max_wheel_torque_nm=0.01)).fix.endswith("it hardly turns")


def test_a_high_load_tips_and_a_slippery_tire_slides() -> None:
    model = shipped("rover")
    high = replace(model.chassis, center_m=(0.0, 0.0, 1.0))
    tipped, slid = lean(replace(model, chassis=high)), lean(smooth(model))
    assert missed(tipped) == {"tips at"}
    assert missed(slid) == {"slides at"}


def smooth(model: VehicleModel) -> VehicleModel:
    return replace(model, wheels=tuple(replace(wheel, friction=0.2) for wheel in model.wheels))


def test_the_same_model_gives_the_same_trial() -> None:
    assert stand(shipped("rover")) == stand(shipped("rover"))


@pytest.mark.parametrize("trial", [stand, turn])
def test_curves_have_a_point_for_each_value(trial: Any) -> None:
    for plot in trial(shipped("rover")).plots:
        for curve in plot.curves:
            assert len(curve.x) == len(curve.y) > 50
