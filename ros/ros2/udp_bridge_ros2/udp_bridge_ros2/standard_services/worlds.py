# SPDX-License-Identifier: Apache-2.0
"""The loaded world, and the worlds that can be loaded."""

from __future__ import annotations

from typing import Any

from .messages import read_resource, read_tags, world_resource
from .request_refused import RequestRefused
from .run_state import RunStateServices
from .world_queries import WorldQueries


class WorldServices:
    """Handlers of requests about worlds; any thread may call them."""

    def __init__(self, queries: WorldQueries, run_state: RunStateServices) -> None:
        self._queries = queries
        self._run_state = run_state

    def current(self, _: Any, response: Any) -> None:
        """Return the loaded world."""
        response.world = world_resource(self._queries.world())

    def load(self, request: Any, response: Any) -> None:
        """Load a world, which leaves the simulation stopped.

        A file is read strictly: its mistakes and missing assets are errors, whatever the flags say.
        """
        uri, text = read_resource(request, "world_resource")
        with self._run_state.loading_world():
            response.world = world_resource(self._queries.load_world(uri, "" if uri else text))

    def unload(self, _: Any, __: Any) -> None:
        """Unload the world."""
        self._queries.unload_world()

    def available(self, request: Any, response: Any) -> str:
        """Return the worlds that can be loaded; all sources are local."""
        selection = read_tags(request.filter)
        rows, unknown = self._queries.worlds(request.additional_sources)
        message = f"unrecognized sources: {', '.join(unknown)}" if unknown else ""
        if unknown and not (request.continue_on_error and rows):
            raise RequestRefused("RESULT_OPERATION_FAILED", message)
        response.worlds = [world_resource(row) for row in rows if selection.accepts(row.tags)]
        return message
