# SPDX-License-Identifier: Apache-2.0
"""The run that physics serves: episodes, pacing, participants, control and restore.

Imported by `services.physics.__main__`. Computes no forces.
"""
