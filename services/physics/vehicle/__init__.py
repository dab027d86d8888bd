# SPDX-License-Identifier: Apache-2.0
"""Vehicle: chassis, running gear, tires, motors, steering and joints.

Imported by `services.physics.simulation`. Knows no bus and no wall clock.
"""
