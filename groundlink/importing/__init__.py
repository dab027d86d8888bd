# SPDX-License-Identifier: Apache-2.0
"""Files of others (heightmaps, meshes, scans) and recipes, made into assets and world data.

Rule: only the process that reads a scenario's files comes here, and only here are libraries of file
formats used, each imported where its format is met. What comes out needs none of them. Whatever is
wrong with a file is a `BadFile` of one line; what is merely doubtful is told and goes on.
"""
