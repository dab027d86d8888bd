# SPDX-License-Identifier: Apache-2.0
"""Lens, shutter and image sensor of a camera.

Imported by `rendering.cameras`. Arrays in, arrays out.
"""
