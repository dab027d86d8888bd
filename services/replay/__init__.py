# SPDX-License-Identifier: Apache-2.0
"""Replay: publishes a recorded run on the bus again.

Imported by nobody. It replaces physics and sensors, and never changes a recorded message.
"""
