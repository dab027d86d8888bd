# SPDX-License-Identifier: Apache-2.0
"""Pictures of worlds and vehicles for people: from a good point of view, with their frames."""
