# SPDX-License-Identifier: Apache-2.0
"""ROS 2 forms of bus messages: types, CDR encoding and decoding, topics, and the base driver.

Imported by gateway, recorder, replay and viewers. Imports no ROS installation.
"""
