# SPDX-License-Identifier: Apache-2.0
"""UDP relay that emulates an impaired link, for any UDP traffic; it needs no run and no root.

Imported by nobody. It knows sockets and the models of `groundlink.emulation`, and no bus.
"""
