# SPDX-License-Identifier: Apache-2.0
"""Installation of the node with catkin. `catkin_pkg` reads the metadata from package.xml."""

from __future__ import annotations

from setuptools import setup

setup(
    name="udp_bridge_ros1",
    version="0.1.0",
    packages=["udp_bridge_ros1"],
    package_dir={"": "src"},
)
