# SPDX-License-Identifier: Apache-2.0
"""The wheel encoders' process."""
