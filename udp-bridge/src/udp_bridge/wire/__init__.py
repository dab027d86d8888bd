# SPDX-License-Identifier: Apache-2.0
"""Wire format: headers, fragments, bodies of the bridge's own messages, sealing, capture files.

May be imported by everything here. Bytes in, values out; no state, clock or socket.
"""
