# SPDX-License-Identifier: Apache-2.0
"""The run's authority: PyBullet at 400 Hz, paced, and what every replica needs served."""
