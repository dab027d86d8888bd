# SPDX-License-Identifier: Apache-2.0
"""Installation of the node with colcon (ament_python) or pip."""

from __future__ import annotations

from setuptools import setup

NAME = "udp_bridge_ros2"

setup(
    name=NAME,
    version="0.1.0",
    description="The ROS 2 end of UDP Bridge: datagrams become messages, commands go back.",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=[NAME, f"{NAME}.standard_services"],
    package_data={NAME: ["fastdds_profile.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", ["config/bridge.yaml"]),
        (f"share/{NAME}/launch", ["launch/bridge.launch.xml", "launch/run.launch.xml"]),
        (f"share/{NAME}/rviz", ["rviz/groundlink.rviz"]),
    ],
    # rclpy and the message packages come with ROS, or from the wheels that replace it.
    install_requires=["udp-bridge"],
    zip_safe=True,
    entry_points={"console_scripts": [f"{NAME} = {NAME}.__main__:main"]},
)
