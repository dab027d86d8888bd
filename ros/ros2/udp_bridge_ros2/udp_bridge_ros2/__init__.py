# SPDX-License-Identifier: Apache-2.0
"""ROS 2 end of UDP Bridge. It imports only rclpy, message packages and `udp_bridge`."""
