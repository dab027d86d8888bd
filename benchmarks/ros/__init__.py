# SPDX-License-Identifier: Apache-2.0
"""From a measurement to a ROS 2 callback, beside plain ROS 2."""
