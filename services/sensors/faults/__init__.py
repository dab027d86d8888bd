# SPDX-License-Identifier: Apache-2.0
"""Faults: what each kind of fault does to a reading, around any sensor model.

Imported by the runtime. Models know nothing of it.
"""
