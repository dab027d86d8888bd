# SPDX-License-Identifier: Apache-2.0
"""The age of data at the end of a lossy link: the bridge and TCP, on real sockets."""
