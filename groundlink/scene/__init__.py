# SPDX-License-Identifier: Apache-2.0
"""Scene: what a scenario's world holds as solids, body numbers, vehicle links and spawn poses.

May be imported by everything above `scenario` and `world`. Reads no file.
"""
