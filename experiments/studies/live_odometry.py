# SPDX-License-Identifier: Apache-2.0
"""Live odometry: nodes of `examples` beside the bridge, with a LiDAR outdoors and with a camera.

In real time as in the paper. A short run waits for the node instead, so that a slow machine
changes nothing.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.estimation.environments import python_of
from experiments.estimation.evaluation import Evaluation
from experiments.estimation.programs import KISS_ICP
from experiments.experiment import ExperimentOptions, evaluate_estimate
from experiments.output import figures
from experiments.recording.live_nodes import LiveNode, packages_of, record_beside
from experiments.recording.setups import Setup, shipped

from .indoor_cameras import RGBD, ROUNDED
from .indoor_cameras import SECONDS as LAP_S
from .outdoors import SCENARIO as HAMLET

ROAD_S = 75.0
SHORT_S = 3.0
CLOUDS = LiveNode(
    script="kiss_icp_node/kiss_icp_node.py",
    takes="/points",
    odometry="/lidar_odometry",
    rate_hz=10.0,
    frame="lidar_link",
    parameters=("lowest_m:=-1.0",),
)
"""The LiDAR is 2.4 m above the road, which a VLP-16 sees as circles that move with the tank."""

PICTURES = LiveNode(
    script="visual_odometry_node/visual_odometry_node.py",
    takes="/camera/depth/image_rect_raw",
    odometry="/visual_odometry",
    rate_hz=15.0,
    frame="camera_optical_frame",
)


def lidar(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run KISS-ICP as a ROS node beside a tank on a road of 170 m, in real time (6.4)."""
    packages = packages_of(python_of(KISS_ICP, options.out, options.console))
    route = shipped(HAMLET)["vehicles"][0]["route"] | {"wait_s": 0.5}
    setup = Setup(
        name="live_lidar",
        scenario=HAMLET,
        seconds=SHORT_S if options.short else ROAD_S,
        sensors={"camera": None, "gnss": None, "imu": None, "lidar": {"block_deg": 0}},
        vehicle={"route": route},
    )
    return _odometry(options, setup, CLOUDS, "kiss-icp", packages)


def camera(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run visual odometry by OpenCV as a ROS node beside a depth camera, in real time (6.3)."""
    setup = Setup(
        name="live_camera",
        scenario="indoor_paper",
        seconds=SHORT_S if options.short else LAP_S,
        sensors=RGBD,
        vehicle=ROUNDED,
    )
    return _odometry(options, setup, PICTURES, "visual odometry")


def _odometry(
    options: ExperimentOptions,
    setup: Setup,
    node: LiveNode,
    program: str,
    packages: Path | None = None,
) -> Sequence[Evaluation]:
    results = []
    setup = node.beside(setup, waits=options.short).varied(options.vary)
    for seed in options.seeds:
        folder = options.folder("runs", f"{setup.name}-{seed}")
        recording, tum = record_beside(
            replace(setup, seed=seed), node, folder, options.console, packages
        )
        result, path = evaluate_estimate(
            *(options, recording, tum),
            frame=node.frame,
            experiment=setup.name,
            program=program,
            took_s=setup.seconds,
        )
        results.append(result)
        if seed == options.seeds[0]:
            figures.trajectories(options.figure(setup.name), recording.scenario, [path])
    return results
