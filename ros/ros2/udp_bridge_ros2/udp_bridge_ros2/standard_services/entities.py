# SPDX-License-Identifier: Apache-2.0
"""Entities: lists, states, information and bounds."""

from __future__ import annotations

from typing import Any

from .messages import (
    box_bounds,
    entity_info,
    entity_state,
    read_category,
    read_filters,
    read_frame,
    read_pose,
    read_twist,
)
from .request_refused import RequestRefused
from .world_queries import Entity, WorldQueries


class EntityServices:
    """Handlers of requests about entities; any thread may call them."""

    def __init__(self, queries: WorldQueries) -> None:
        self._queries = queries

    def names(self, request: Any, response: Any) -> None:
        """Return the names of entities that match filters."""
        _, entities = self._selected(request)
        response.entities = [entity.name for entity in entities]

    def states(self, request: Any, response: Any) -> None:
        """Return names and states of entities that match filters."""
        stamp_nanos, entities = self._selected(request)
        response.entities = [entity.name for entity in entities]
        response.states = [entity_state(entity, stamp_nanos) for entity in entities]

    def get_state(self, request: Any, response: Any) -> None:
        """Return pose, velocity and acceleration of an entity."""
        stamp_nanos, entity = self._queries.entity(request.entity)
        response.state = entity_state(entity, stamp_nanos)

    def set_state(self, request: Any, _: Any) -> str:
        """Set pose and velocity of an entity; an acceleration is ignored.

        Version 1 of the standard has no flags and sets both.
        """
        state = request.state
        pose = read_pose(state.pose) if getattr(request, "set_pose", True) else None
        twist = read_twist(state.twist) if getattr(request, "set_twist", True) else None
        acceleration = (
            read_twist(state.acceleration) if getattr(request, "set_acceleration", True) else None
        )
        moves = any(any(vector) for pair in (twist, acceleration) if pair for vector in pair)
        if moves and self._queries.entity(request.entity)[1].is_static:
            raise RequestRefused(
                "RESULT_OPERATION_FAILED", f"{request.entity} is static and can't move"
            )
        self._queries.place(request.entity, pose, twist, read_frame(state.header))
        ignored = acceleration and any(any(vector) for vector in acceleration)
        return "the acceleration was ignored" if ignored else ""

    def get_info(self, request: Any, response: Any) -> None:
        """Return category, description and tags of an entity."""
        response.info = entity_info(self._queries.entity(request.entity)[1])

    def set_info(self, request: Any, _: Any) -> None:
        """Replace category, description and tags of an entity."""
        info = request.info
        category = read_category(info.category)
        self._queries.describe(request.entity, category, info.description, info.tags)

    def get_bounds(self, request: Any, response: Any) -> None:
        """Return the box of an entity, in its own frame."""
        _, entity = self._queries.entity(request.entity)
        response.bounds = box_bounds(entity.low_m, entity.high_m)

    def _selected(self, request: Any) -> tuple[int, list[Entity]]:
        selection = read_filters(request.filters)
        stamp_nanos, entities = self._queries.entities()
        return stamp_nanos, [entity for entity in entities if selection.accepts(entity)]
