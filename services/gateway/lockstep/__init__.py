# SPDX-License-Identifier: Apache-2.0
"""Lockstep of a run with ROS: the table of its states, the barriers, and the node's replies.

Imported by the gateway alone. Nothing here opens a socket, reads a clock or joins the bus.
"""
