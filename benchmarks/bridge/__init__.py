# SPDX-License-Identifier: Apache-2.0
"""UDP Bridge beside a C program, TCP and the ROS# way, in one run on one host."""
