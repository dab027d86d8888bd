# SPDX-License-Identifier: Apache-2.0
"""OpenGL drawing: context, shader programs, scene, shadows, terrain and render targets.

Imported by cameras and portraits. Reads materials from `look` only.
"""
