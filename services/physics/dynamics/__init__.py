# SPDX-License-Identifier: Apache-2.0
"""Dynamics: the PyBullet engine, solids, meshes and terrain, and sums over energy and contacts.

Imported by vehicle and simulation. Knows no bus and no wall clock; `engine` alone imports pybullet.
"""
