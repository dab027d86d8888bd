# SPDX-License-Identifier: Apache-2.0
"""Commands about data sheets of sensors."""
