# SPDX-License-Identifier: Apache-2.0
"""Writes a run to a file that robotics tools open: MCAP with ROS 2 messages."""
