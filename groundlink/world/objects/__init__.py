# SPDX-License-Identifier: Apache-2.0
"""Objects of a world: furniture, houses, trees and clutter as solids.

Imported by the world builder and the loader. Draws randomness from generators passed in.
"""
