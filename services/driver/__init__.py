# SPDX-License-Identifier: Apache-2.0
"""Drives a vehicle along its route, by commands as any ROS node gives them."""
