# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus: one module a family, with their MessagePack encoding.

May be imported by everything except `core`. A message knows no topic, no bus and no ROS type.
"""
