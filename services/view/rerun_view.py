# SPDX-License-Identifier: Apache-2.0
"""A run as a Rerun recording: the world first, then every message of the bus.

States place vehicles and actors, at most 30 times a second. The table in `draw_messages` draws the
other messages. `rerun_destinations` opens the recording: a window, a browser or a file.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from groundlink.core.clock import NANOS
from groundlink.core.frames import conjugate, matrix_from_quaternion
from groundlink.messages.base import BusMessage, Health, State, floats
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.ros.streams import RosStream
from groundlink.scenario import Scenario
from groundlink.scene.bodies import link_solids
from groundlink.world import actors

from . import link_panel
from .colors import Coloring
from .draw_messages import FORMS
from .drawing import WORLD, Drawing, Track
from .layout import TEXT
from .meshes import ShadedMesh, mesh, world
from .rerun_destinations import RerunDestination

FRAME_NANOS = NANOS // 30
"""Simulation time between two drawn poses of a vehicle."""

ROOT = "tf#/"
"""Rerun's name for the frame of the entity at the root."""

TRUTH = (90, 220, 255)
"""Color of the true trajectory."""

WORLD_LIGHT = 0.6
"""Static things are drawn darker, so that points and vehicles stand out."""

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class RerunView:
    """A run in a Rerun recording.

    Parameters
    ----------
    destination
        opens a recording for each episode, since simulation time begins again, and for each world.
    """

    def __init__(
        self, scenario: Scenario, run: str, *, coloring: Coloring, destination: RerunDestination
    ) -> None:
        self._scenario, self._run = scenario, run
        self._coloring = coloring
        self._destination = destination
        self._monitor = RunMonitor()
        self._next_frame_nanos = 0
        self._next_plot_nanos = 0
        self._episode: int | None = None
        self._is_drawn = False
        """Whether vehicles and actors are drawn already."""

        self.drawing = self._begin()

    def change(self, scenario: Scenario) -> None:
        """Draw another world from now on, in a new recording."""
        self.drawing.plots.flush()
        self._scenario = scenario
        self.drawing = self._begin()

    def begin_again(self) -> None:
        """Take states from the start once more, only to place further messages."""
        self.drawing.plots.flush()
        self._is_drawn = True
        for track in self.drawing.vehicles.values():
            track.forget()

    def take_states(self, states: Sequence[State]) -> None:
        """Take states; draw the newest of them when it is due."""
        for state in states:
            if state.episode != self._episode:
                if self._episode is not None:
                    self.drawing = self._begin()
                self._episode = state.episode
            self.drawing.epoch_nanos = state.epoch_nanos
            self.drawing.now_nanos = state.sim_nanos
            for name, track in self.drawing.vehicles.items():
                if name in state.vehicles:
                    track.take(state.stamp_nanos, state.vehicles[name].poses())
        if states and not self._is_drawn and self.drawing.now_nanos >= self._next_frame_nanos:
            self._next_frame_nanos = self.drawing.now_nanos + FRAME_NANOS * 3 // 4
            newest = {name: state for state in states for name in state.vehicles}
            for name, track in self.drawing.vehicles.items():
                if name in newest:
                    self._draw(newest[name], track)
            poses = floats(states[-1].actors).reshape(-1, 7).tolist()
            for actor, pose in zip(self._scenario.world.actors, poses, strict=False):
                self.drawing.move(actor.name, WORLD, pose, states[-1].stamp_nanos)

    def take(self, path: str, stream: RosStream, message: BusMessage) -> None:
        """Draw a message of a vehicle, if a state came before it: its epoch is needed."""
        track = self.drawing.vehicles.get(path.partition("/")[0])
        if self.drawing.epoch_nanos is not None and track is not None:
            if draw := FORMS.get(stream.message):
                draw(self.drawing, track, path, message)
            else:
                self.drawing.not_drawn += 1

    def take_health(self, health: Health, now_seconds: float) -> None:
        """Show the health of a process."""
        self._monitor.update(health, now_seconds)
        if self.drawing.epoch_nanos is None:
            return
        if health.streams:
            link_panel.plot(self.drawing.plots, self.drawing.now_nanos, health)
        if health.process == "physics":
            color = {"intensity": "intensity", "ring": "laser"}[self._coloring]
            title = f"{self._scenario.name} · run {self._run}"
            said = link_panel.text(title, self._monitor, shown=f"points colored by {color}")
            stamp = self.drawing.epoch_nanos + self.drawing.now_nanos
            self.drawing.log(TEXT, stamp, rr.TextDocument(said, media_type="text/markdown"))

    def show_text(self, text: str) -> None:
        """Show a text in the run's panel."""
        document = rr.TextDocument(text, media_type="text/markdown")
        self.drawing.recording.log(TEXT, document, static=True)

    def flush(self) -> None:
        """Pass the plots to Rerun, some times a second of simulation time."""
        if self._is_drawn or self.drawing.now_nanos >= self._next_plot_nanos:
            self._next_plot_nanos = self.drawing.now_nanos + NANOS // 5
            self.drawing.plots.flush()

    def alive(self) -> bool:
        """Return whether the view is still open."""
        return self._destination.alive()

    def counters(self) -> dict[str, int]:
        """Return how many messages could not be drawn."""
        return {"not_drawn": self.drawing.not_drawn}

    def close(self) -> None:
        """Show waiting data and close."""
        self.drawing.plots.flush()
        self._destination.close()

    def _begin(self) -> Drawing:
        """Return a new recording with all static things."""
        recording = self._destination.new_recording()
        drawing = Drawing(recording, self._scenario, self._coloring)
        self._next_frame_nanos = self._next_plot_nanos = 0
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        drawing.fix(WORLD, ROOT, IDENTITY)
        for name, solid in world(self._scenario).items():
            recording.log(f"world/{name}", _drawn(solid, WORLD_LIGHT), static=True)
        materials = self._scenario.world.materials
        for actor in self._scenario.world.actors:
            path = f"actors/{actor.name}"
            drawing.in_frame(path, actor.name)
            recording.log(
                path, _drawn(mesh(actors.form_solids(actor.form), materials)), static=True
            )
        for track in drawing.vehicles.values():
            model, prefix = track.spec.model, track.spec.frame_prefix
            for link, parts in zip(model.link_names(), link_solids(model), strict=True):
                path = f"{track.spec.name}/links/{link}"
                drawing.in_frame(path, prefix + link)
                recording.log(path, _drawn(mesh(parts, materials)), static=True)
            for sensor in track.spec.sensors:
                frame = prefix + sensor.frame
                placed = track.link_from(frame)
                if frame != track.base_frame and placed is not None:
                    place, at = placed
                    mount = rr.Transform3D(
                        translation=at[:3, 3],
                        mat3x3=at[:3, :3],
                        parent_frame=prefix + model.link_names()[place],
                        child_frame=frame,
                    )
                    recording.log(f"tf/{frame}", mount, static=True)
        return drawing

    def _draw(self, state: State, track: Track) -> None:
        """Draw the pose and velocity of a vehicle."""
        vehicle, drawing = state.vehicles[track.spec.name], self.drawing
        name, prefix = track.spec.name, track.spec.frame_prefix
        poses = vehicle.poses()
        for link, pose in zip(track.spec.model.link_names(), poses.tolist(), strict=False):
            drawing.move(prefix + link, WORLD, pose, state.stamp_nanos)
        # Just above the floor, so that the vehicle does not hide it.
        x, y, z = poses[0, :3].tolist()
        if track.trail.add((x, y, z - track.spec.model.base_height_m + 0.01)):
            line = rr.LineStrips3D([track.trail.points], colors=[TRUTH], radii=[-2.5])
            drawing.log(f"{name}/path", state.stamp_nanos, line)
        base_from_world = matrix_from_quaternion(conjugate(poses[0, 3:]))
        linear, angular = floats(vehicle.base_velocity).reshape(2, 3) @ base_from_world.T
        at = state.sim_nanos
        drawing.plots.add(f"{name}/speed/true", at, [float(linear[0])], ["true"], [TRUTH])
        drawing.plots.add(f"{name}/turning/true", at, [float(angular[2])], ["true"], [TRUTH])


def _drawn(solid: ShadedMesh, light: float = 1.0) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=solid.vertices,
        triangle_indices=np.arange(len(solid.vertices), dtype=np.uint32).reshape(-1, 3),
        vertex_normals=solid.normals,
        vertex_colors=solid.colors,
        albedo_factor=[light, light, light, 1.0],
        face_rendering="Front",
    )
