# SPDX-License-Identifier: Apache-2.0
"""Clauses of the standard, one test each, named after what must hold.

A docstring says the clause in own words, the mark `clause` where it stands in the standard. Where
two comments of the standard differ, a simulator may follow either.
"""
