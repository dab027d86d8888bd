# SPDX-License-Identifier: Apache-2.0
"""Drawing with OpenGL: context, programs, stage, shadows, terrain and render targets.

Imported by `rendering` alone. Knows materials only through `look`.
"""
