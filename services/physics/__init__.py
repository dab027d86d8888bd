# SPDX-License-Identifier: Apache-2.0
"""The physics process: simulates the world at 400 Hz, paces the run and serves its replicas."""
