# SPDX-License-Identifier: Apache-2.0
"""Pictures of a replicated world, by OpenGL: colour, depth and labels in one pass."""
