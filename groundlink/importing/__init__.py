# SPDX-License-Identifier: Apache-2.0
"""Importers: convert heightmaps, meshes and scans into assets and world data.

Imported by the loader and by `groundlink world`; each library of a file format is imported on first
use. An unusable file raises `BadFile` with one line; a doubtful one is reported as a warning.
"""
