# SPDX-License-Identifier: Apache-2.0
"""Recordings in a viewer, with streams that are simulated while the viewer is open.

Imported by the viewer's process. It starts processes that simulate sensors and loads no loader.
"""
