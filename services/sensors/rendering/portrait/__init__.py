# SPDX-License-Identifier: Apache-2.0
"""Portraits: pictures of worlds and vehicles for people, from a good viewpoint."""
