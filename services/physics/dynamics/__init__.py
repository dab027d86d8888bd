# SPDX-License-Identifier: Apache-2.0
"""Dynamics: the physics engine behind an interface, static solids, terrain, energy and contacts.

Imported by vehicle and simulation. Knows no bus and no wall clock; only `bullet` imports pybullet.
"""
