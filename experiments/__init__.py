# SPDX-License-Identifier: Apache-2.0
"""Experiments: the studies of the paper as commands, with external SLAM programs.

Uses Groundlink as a user does: scenarios, commands and topics. External programs run as processes
of their own; their drivers read bags and know nothing of Groundlink.
"""
