# SPDX-License-Identifier: Apache-2.0
"""The run's door to ROS: streams of the bus out as datagrams, commands in."""
