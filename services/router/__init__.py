# SPDX-License-Identifier: Apache-2.0
"""Where the processes of runs on several machines, or in containers, meet."""
