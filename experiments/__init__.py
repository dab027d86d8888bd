# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments as commands, with SLAM programs that others wrote.

Rule: knows Groundlink as any user does: scenarios, commands, topics. Programs of others never run
in this process, and what feeds them knows nothing of Groundlink: it reads a bag.
"""
