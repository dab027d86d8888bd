# SPDX-License-Identifier: Apache-2.0
"""Errors at checkpoints, and their sums."""

import numpy as np
import pytest

from experiments.estimation.checkpoints import accumulated_errors, aligned_at_start
from groundlink.core.frames import matrix_from_quaternion, multiply
from groundlink.data.trajectory import Trajectory

SECONDS = np.arange(0.0, 40.05, 0.1)
CHECKPOINTS = {"start": (0.0, 0.0), "middle": (5.0, 0.0), "end": (10.0, 0.0)}
QUARTER = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])


def _there_and_back() -> Trajectory:
    x = 10.0 - np.abs(0.5 * SECONDS - 10.0)
    positions = np.stack([x, 0 * x, 0 * x], axis=1)
    return Trajectory(SECONDS, positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(x), 1)))


def _seen_elsewhere(way: Trajectory) -> Trajectory:
    """Return a way in a world that is turned and moved."""
    positions = way.positions_m @ matrix_from_quaternion(QUARTER).T + (3.0, -2.0, 1.0)
    return Trajectory(way.seconds, positions, multiply(QUARTER, way.orientations))


def test_an_estimate_begins_at_the_truth() -> None:
    truth = _there_and_back()
    begun = aligned_at_start(_seen_elsewhere(truth), truth)
    assert begun.positions_m == pytest.approx(truth.positions_m)
    assert begun.orientations == pytest.approx(truth.orientations)


def test_errors_add_up_from_checkpoint_to_checkpoint() -> None:
    truth = _there_and_back()
    # One part in a thousand too long: 0, 5, 10, 5 and 0 mm at the checkpoints.
    long = Trajectory(truth.seconds, truth.positions_m * 1.001, truth.orientations)
    passed = accumulated_errors(_seen_elsewhere(long), truth, truth, CHECKPOINTS)
    assert [p.checkpoint for p in passed] == ["start", "middle", "end", "middle", "start"]
    assert [p.travelled_m for p in passed] == pytest.approx([0, 5, 10, 15, 20], abs=0.1)
    assert [1e3 * p.error_m for p in passed] == pytest.approx([0, 5, 10, 5, 0], abs=1e-6)
    assert [p.sum_mm2 for p in passed] == pytest.approx([0, 25, 125, 150, 150], abs=1e-3)


def test_a_way_that_begins_late_is_judged_where_it_is() -> None:
    truth = _there_and_back()
    passed = accumulated_errors(truth.between(1.0, 39.0), truth, truth, CHECKPOINTS)
    assert len(passed) == 5
    assert passed[-1].sum_mm2 == pytest.approx(0.0, abs=1e-9)
