# SPDX-License-Identifier: Apache-2.0
"""A stack of five ROS 2 nodes in three processes, in lockstep with a run on another host."""
