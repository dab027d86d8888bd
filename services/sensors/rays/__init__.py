# SPDX-License-Identifier: Apache-2.0
"""Rays against the triangles and the terrain of a replicated world, at the instant of each ray."""
