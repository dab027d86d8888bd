# SPDX-License-Identifier: Apache-2.0
"""The parts that the ROS 1 and ROS 2 nodes share.

May be imported by the ROS packages. Imports no ROS: publishers, subscriptions and the graph come in
as protocols.
"""

from __future__ import annotations
