# SPDX-License-Identifier: Apache-2.0
"""Vehicle: controller, chassis, springs and joints, and the fleet that is stepped together.

Imported by `services.physics.simulation`. Knows no bus and no wall clock.
"""
