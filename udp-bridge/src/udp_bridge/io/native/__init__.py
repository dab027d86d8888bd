# SPDX-License-Identifier: Apache-2.0
"""C extension: many datagrams per system call. `batch_io` works without it."""
