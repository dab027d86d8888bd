# SPDX-License-Identifier: Apache-2.0
"""Camera eyes: a lens and an imager before the renderer, and their messages.

Imported by the kinds of cameras. Knows no bus.
"""
