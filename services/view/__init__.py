# SPDX-License-Identifier: Apache-2.0
"""Viewer: shows a run in Rerun, or serves it to Foxglove.

Imported by nobody. It receives messages of the bus and never publishes readings or commands.
"""
