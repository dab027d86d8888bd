# SPDX-License-Identifier: Apache-2.0
"""Lens, shutter and image sensor: what a camera makes of a rendered frame.

Imported by `rendering`. Arrays in, arrays out.
"""
