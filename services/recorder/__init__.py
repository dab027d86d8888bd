# SPDX-License-Identifier: Apache-2.0
"""Recorder: writes a run to an MCAP file with ROS 2 messages.

Imported by nobody; it knows the bus and the recording format, never the link to ROS.
"""
