# SPDX-License-Identifier: Apache-2.0
"""Scanning: what rotating LiDARs share, 3D or planar.

Imported by the models of LiDAR kinds. Knows no messages and no bus.
"""
