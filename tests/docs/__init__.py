# SPDX-License-Identifier: Apache-2.0
"""Tests of the documents: what a page shows is what runs."""
