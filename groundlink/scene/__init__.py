# SPDX-License-Identifier: Apache-2.0
"""Scene: solids, body numbers, vehicle links and spawn poses of a scenario's world.

May be imported by everything above `scenario` and `world`. Reads no file.
"""
