# SPDX-License-Identifier: Apache-2.0
"""The page of a report: HTML sections, the verdict, and the template that holds them.

Imported by the command line. Computes nothing that a figure or the analysis needs.
"""
