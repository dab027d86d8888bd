# SPDX-License-Identifier: Apache-2.0
"""Running gear: motors, shafts, tires and steering joints, from target speeds to forces of wheels.

Imported by `services.physics.vehicle`. Knows no commands, no bus and no wall clock. Each class is a
structure of C.
"""
