# SPDX-License-Identifier: Apache-2.0
"""What things look like: meshes, textures, patterns, labels and lights.

Imported by `rendering.gl`. Calls no OpenGL.
"""
