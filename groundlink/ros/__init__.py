# SPDX-License-Identifier: Apache-2.0
"""ROS 2 side of bus messages: types, CDR encoding and decoding, topics, and the base driver.

Used by gateway, recorder, replay and viewers. Needs no ROS installation.
"""
