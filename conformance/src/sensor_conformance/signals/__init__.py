# SPDX-License-Identifier: Apache-2.0
"""Rotations, delays and robust statistics of arrays. Nothing here knows a message or a clause."""
