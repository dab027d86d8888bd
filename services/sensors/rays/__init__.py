# SPDX-License-Identifier: Apache-2.0
"""Ray casting into a replicated world, with an instant for each ray.

Imported by models of sensors that cast rays. Knows no sensor, noise or message.
"""
