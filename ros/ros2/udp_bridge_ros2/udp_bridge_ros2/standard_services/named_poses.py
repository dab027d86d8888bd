# SPDX-License-Identifier: Apache-2.0
"""Named poses of the world, and the room at them."""

from __future__ import annotations

from typing import Any

from .messages import box_bounds, named_pose, read_tags
from .request_refused import RequestRefused
from .world_queries import WorldQueries


class NamedPoseServices:
    """Handlers of requests about named poses; any thread may call them."""

    def __init__(self, queries: WorldQueries) -> None:
        self._queries = queries

    def poses(self, request: Any, response: Any) -> None:
        """Return the named poses whose tags match."""
        selection = read_tags(request.tags)
        response.poses = [
            named_pose(row) for row in self._queries.named_poses() if selection.accepts(row.tags)
        ]

    def bounds(self, request: Any, response: Any) -> None:
        """Return the bounds of a named pose."""
        for row in self._queries.named_poses():
            if row.name == request.name:
                response.bounds = box_bounds(row.low_m, row.high_m)
                return
        raise RequestRefused("RESULT_NOT_FOUND", f"no named pose {request.name!r}")
