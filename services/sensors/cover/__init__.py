# SPDX-License-Identifier: Apache-2.0
"""Cover of the terrain as sensors see it: standing water and tall grass.

LiDARs and cameras share it. It imports no kind of sensor.
"""
