# SPDX-License-Identifier: Apache-2.0
"""Pictures of a replicated world with OpenGL: color, depth and labels."""
