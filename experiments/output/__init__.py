# SPDX-License-Identifier: Apache-2.0
"""Figures, tables and pages made from the results of experiments."""
