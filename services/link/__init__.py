# SPDX-License-Identifier: Apache-2.0
"""UDP relay that emulates an impaired link, for any UDP traffic; it needs no run and no root."""
