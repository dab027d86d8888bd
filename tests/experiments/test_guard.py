# SPDX-License-Identifier: Apache-2.0
"""When a program is said to have found a fault; who is shown what."""

import pytest

from experiments.recording.faults import CLOUD, FAULTS, IMU, TF
from experiments.recording.setups import ROOT
from experiments.studies.guard import LISTENERS, SETUP, is_worse
from groundlink.loader import load
from groundlink.scene.build import solids
from groundlink.world.solids import Mesh


@pytest.mark.parametrize(
    ("error_m", "usual_m", "worse"),
    [(0.05, 0.01, True), (0.029, 0.01, False), (0.19, 0.1, False), (0.21, 0.1, True)],
)
def test_worse_is_twice_and_two_centimeters(error_m: float, usual_m: float, worse: bool) -> None:
    assert is_worse(error_m, usual_m) == worse


def test_every_fault_is_of_messages_that_somebody_takes() -> None:
    assert {fault.ros_type for fault in FAULTS.values()} == {IMU, CLOUD, TF} == {*LISTENERS, TF}


def test_the_guards_world_has_only_shapes_with_a_distance() -> None:
    scenario = load(ROOT / "scenarios" / f"{SETUP.scenario}.yaml")
    assert not any(isinstance(solid.shape, Mesh) for solid in solids(scenario))
