# SPDX-License-Identifier: Apache-2.0
"""What both ROS ends are made of, ROS 2's and ROS 1's, and that knows no ROS.

Rule: ROS comes in as a few functions; queues, leases, verdicts and addresses are the same in both.
"""

from __future__ import annotations
