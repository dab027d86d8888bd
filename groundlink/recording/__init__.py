# SPDX-License-Identifier: Apache-2.0
"""A run as a file: MCAP with ROS 2 messages, written so that a kill leaves it whole, and read."""
