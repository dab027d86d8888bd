# SPDX-License-Identifier: Apache-2.0
"""The node in C++ of ROS 2, compiled against stubs of rclcpp."""
