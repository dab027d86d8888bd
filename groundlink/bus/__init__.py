# SPDX-License-Identifier: Apache-2.0
"""The bus: Zenoh sessions, topics, queries, inboxes and credentials.

May be imported by every process. `session` is the only module that imports zenoh.
"""
