# SPDX-License-Identifier: Apache-2.0
"""Simulation: one world with its vehicles and actors, stepped tick by tick.

Imported by `services.physics.run`. Knows no bus and no wall clock.
"""
