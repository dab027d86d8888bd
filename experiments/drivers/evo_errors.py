# SPDX-License-Identifier: Apache-2.0
"""Errors of a trajectory: `python evo_errors.py TRUTH.tum ESTIMATE.tum [--scale] --out FILE`.

Runs in evo's environment. Both files have poses at the same times. The estimate is aligned with the
truth by SE(3), or with `--scale` by Sim(3), and the aligned estimate is written. Prints one line of
JSON. `over_100_m` is the relative error as KITTI defines it: the translation error of the motion
over 100 m of the true path, as a share of it, mean over all windows; 0 for a shorter path.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from evo.core import metrics, sync
from evo.core.trajectory import PoseTrajectory3D
from evo.tools import file_interface

WINDOW_M = 100.0
WINDOW_TOLERANCE = 0.01
"""Share of a window by which its length may differ: poses are apart."""


def main() -> None:
    """Align, measure, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("truth")
    parser.add_argument("estimate")
    parser.add_argument("--scale", action="store_true", help="the estimate's scale is unknown")
    parser.add_argument("--out", required=True, help="aligned estimate (TUM)")
    options = parser.parse_args()
    truth = file_interface.read_tum_trajectory_file(options.truth)
    estimate = file_interface.read_tum_trajectory_file(options.estimate)
    truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=1e-4)
    _, _, scale = estimate.align(truth, correct_scale=options.scale)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, estimate))
    file_interface.write_tum_trajectory_file(options.out, estimate)
    drift = (estimate.positions_xyz[-1] - estimate.positions_xyz[0]) - (
        truth.positions_xyz[-1] - truth.positions_xyz[0]
    )
    told = {
        "ate_m": error.get_statistic(metrics.StatisticsType.rmse),
        "largest_m": error.get_statistic(metrics.StatisticsType.max),
        "start_to_end_m": float(np.linalg.norm(drift)),
        "poses": len(error.error),
        "scale": float(scale),
        "way_m": float(truth.path_length),
        "over_100_m": relative_error(truth, estimate),
    }
    print(json.dumps(told))


def relative_error(truth: PoseTrajectory3D, estimate: PoseTrajectory3D) -> float:
    """Return the mean translation error over 100 m, as a share; 0 for a shorter path."""
    if truth.path_length < WINDOW_M:
        return 0.0
    error = metrics.RPE(
        *(metrics.PoseRelation.translation_part, WINDOW_M, metrics.Unit.meters, WINDOW_TOLERANCE),
        all_pairs=True,
        pairs_from_reference=True,
    )
    error.process_data((truth, estimate))
    return float(error.get_statistic(metrics.StatisticsType.mean)) / WINDOW_M


if __name__ == "__main__":
    main()
