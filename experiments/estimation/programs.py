# SPDX-License-Identifier: Apache-2.0
"""External programs of the experiments, each pinned and in an environment of its own.

None of them is a dependency of Groundlink. pip installs them on first use.
"""

from dataclasses import dataclass
from pathlib import Path

DRIVERS = Path(__file__).parents[1] / "drivers"


@dataclass(frozen=True, kw_only=True)
class ExternalProgram:
    """An external program."""

    name: str
    what: str
    requirements: tuple[str, ...]
    """Requirements for pip; wheels only, unless an option allows more."""

    driver: str
    """Driver script in `drivers`."""

    license: str
    libraries: tuple[str, ...] = ()
    """Required shared libraries of the system."""


BAG_READER = ("rosbags==0.11.9", "numpy==2.4.6")
"""Requirements of every driver."""

ROS_2 = (
    "ros-kilted-rclpy==9.1.2",
    "ros-kilted-rmw-fastrtps-cpp==9.3.3",
    "ros-kilted-rmw-implementation==3.0.4",
    "ros-kilted-rosidl-typesupport-fastrtps-c==3.8.1",
    "ros-kilted-rosidl-typesupport-fastrtps-cpp==3.8.1",
    "ros-kilted-geometry-msgs==5.5.1",
    "ros-kilted-nav-msgs==5.5.1",
    "ros-kilted-sensor-msgs==5.5.1",
    "--no-binary=empy",  # which rosidl wants, and which has no wheel
)
"""What a node of rclpy needs, as in pyproject.toml."""

DEBIAN_PACKAGES = {
    "libOpenGL.so.0": "libopengl0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libGLX.so.0": "libglx0",
}
"""By shared library of OpenGL: Debian's package of it."""

YAG_SLAM = ExternalProgram(
    name="yag-slam",
    what="2D graph SLAM with loop closure on laser scans and wheel odometry, after OpenKarto",
    requirements=("yag-slam==0.2.5", "opencv-python-headless==5.0.0.93", *BAG_READER),
    driver="yag_slam_2d.py",
    license="LGPL-3.0",
)
ORB_SLAM3 = ExternalProgram(
    name="orb-slam3",
    what="ORB-SLAM3 on one camera, or on a camera with depth",
    requirements=("pyorbslam3==0.1.1", "opencv-python-headless==5.0.0.93", *BAG_READER),
    driver="orb_slam3.py",
    license="GPL-3.0",
    libraries=tuple(DEBIAN_PACKAGES),
)
GENZ_LIO = ExternalProgram(
    name="genz-lio",
    what="LiDAR-inertial odometry; reads bags by its own loader",
    requirements=("genz-lio==0.1.1", *BAG_READER),
    driver="genz_lio_odometry.py",
    license="GPL-2.0-only",
)
KISS_ICP = ExternalProgram(
    name="kiss-icp",
    what="odometry by a LiDAR alone; reads bags by its own loader",
    requirements=("kiss-icp==1.3.0", *BAG_READER),
    driver="kiss_icp_odometry.py",
    license="MIT",
)
SMALL_GICP = ExternalProgram(
    name="small-gicp",
    what="odometry by a LiDAR alone, with the library's voxel map (VGICP)",
    requirements=("small-gicp==1.0.1", *BAG_READER),
    driver="small_gicp_odometry.py",
    license="MIT",
)
RKO_LIO = ExternalProgram(
    name="rko-lio",
    what="LiDAR-inertial odometry with the same settings for any sensor",
    requirements=("rko-lio==0.4.0", *BAG_READER),
    driver="rko_lio_odometry.py",
    license="MIT",
)
EVO = ExternalProgram(
    name="evo",
    what="errors of trajectories",
    requirements=("evo==1.38.1", "numpy==2.4.6"),
    driver="evo_errors.py",
    license="GPL-3.0",
)

YAG_SLAM_LIVE = ExternalProgram(
    name="yag-slam-live",
    what="the same as a ROS 2 node",
    requirements=(*YAG_SLAM.requirements, *ROS_2),
    driver="yag_slam_live.py",
    license="LGPL-3.0",
)

PROGRAMS = {
    program.name: program
    for program in (
        *(YAG_SLAM, YAG_SLAM_LIVE, ORB_SLAM3),
        *(GENZ_LIO, KISS_ICP, SMALL_GICP, RKO_LIO),
        EVO,
    )
}
