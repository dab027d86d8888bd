# SPDX-License-Identifier: Apache-2.0
"""Recordings: MCAP files with the ROS 2 messages of a run; write, read, play and compare them.

Imported by the recorder, replay, the viewer, the report and the command line. Never joins a bus.
"""
