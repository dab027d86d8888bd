# SPDX-License-Identifier: Apache-2.0
"""Latency from a measurement to a ROS 2 callback, compared with plain ROS 2."""
