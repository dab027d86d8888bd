# SPDX-License-Identifier: Apache-2.0
"""The stereo pair's process."""
