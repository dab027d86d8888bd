# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus and their MessagePack encoding, one module a family.

May be imported by everything except `core`. Independent of topics, the bus and ROS types.
"""
