# SPDX-License-Identifier: Apache-2.0
"""Where messages come from: bags, memory, a running ROS 2 system.

A source lists its topics and gives the messages of one topic. Nothing here knows a clause.
"""
