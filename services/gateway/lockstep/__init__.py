# SPDX-License-Identifier: Apache-2.0
"""Lockstep of a run with ROS: barriers, replies, and the progress of sensors.

Imported by the gateway's process alone.
"""
