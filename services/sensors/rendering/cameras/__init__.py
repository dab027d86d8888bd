# SPDX-License-Identifier: Apache-2.0
"""Camera eyes: renderer, lens and image sensor combined, and their messages.

Imported by the kinds of cameras. Knows no bus.
"""
