# SPDX-License-Identifier: Apache-2.0
"""Shows a run while it goes on: in Rerun, and to Foxglove as if it were a robot."""
