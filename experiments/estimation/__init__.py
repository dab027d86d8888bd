# SPDX-License-Identifier: Apache-2.0
"""SLAM programs: how each is installed, run and judged against the ground truth."""
