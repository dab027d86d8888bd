# SPDX-License-Identifier: Apache-2.0
"""Entities that are put into the world and removed from it."""

from __future__ import annotations

from functools import partial
from typing import Any

from .messages import read_frame, read_pose, read_resource, spawnable
from .request_refused import RequestRefused
from .results import outcome
from .world_queries import WorldQueries

FORMATS = ["groundlink_yaml"]
"""Formats of files and texts that can be spawned: vehicles and worlds of Groundlink."""


class SpawnServices:
    """Handlers of requests to spawn and delete; any thread may call them."""

    def __init__(self, queries: WorldQueries) -> None:
        self._queries = queries

    def spawn_entity(self, request: Any, response: Any) -> None:
        """Spawn one entity."""
        uri, text = read_resource(request, "entity_resource")
        response.entity_name = self._queries.spawn(
            request.name,
            read_pose(request.initial_pose.pose),
            read_frame(request.initial_pose.header),
            uri=uri,
            text="" if uri else text,
            allow_renaming=request.allow_renaming,
            namespace=request.entity_namespace,
        )

    def spawn_entities(self, request: Any, response: Any) -> None:
        """Spawn several entities, one after another; each has a result of its own."""
        from simulation_interfaces.msg import SpawnResult  # since version 2.1

        for row in request.spawn_requests:
            result = SpawnResult()
            result.result = outcome(SpawnResult, partial(self.spawn_entity, row, result))
            response.results.append(result)
        failed = sum(row.result.result != row.result.RESULT_OK for row in response.results)
        if failed:
            raise RequestRefused(
                "ENTITIES_SPAWN_FAILED", f"{failed} of {len(response.results)} were not spawned"
            )

    def delete_entity(self, request: Any, _: Any) -> None:
        """Remove an entity."""
        self._queries.remove(request.entity)

    def get_spawnables(self, request: Any, response: Any) -> str:
        """Return what can be spawned by `uri`."""
        rows, unknown = self._queries.spawnables(request.sources)
        response.spawnables = [spawnable(row) for row in rows]
        return f"unrecognized sources: {', '.join(unknown)}" if unknown else ""
