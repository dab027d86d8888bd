# SPDX-License-Identifier: Apache-2.0
"""Replay: publishes a recorded run on the bus again."""
