# SPDX-License-Identifier: Apache-2.0
"""Sessions on the bus (Zenoh), topics, queries, inboxes and credentials.

May be imported by every process. Only `session` imports zenoh.
"""
