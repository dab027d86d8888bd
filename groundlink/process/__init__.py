# SPDX-License-Identifier: Apache-2.0
"""What every process of a run does: arguments, signals, joining the run, following its states.

Imported by services. Knows no kind of process.
"""
