# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 end of UDP Bridge. It imports rclpy, message packages and `udp_bridge`, no more."""
