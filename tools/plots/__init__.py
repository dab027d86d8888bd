# SPDX-License-Identifier: Apache-2.0
"""Plots of docs/explanation, measured on the models that a run uses.

A figure is a function without arguments. Only the tests import this package.
"""
