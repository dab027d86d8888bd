# SPDX-License-Identifier: Apache-2.0
"""Terramechanics: sinkage of wheels and tracks in soil, and the forces of the soil on them.

Pure functions of soil, wheel, load and slip; they know no vehicle and no physics engine.
"""
