# SPDX-License-Identifier: Apache-2.0
"""Rotating LiDAR scanner: takes states of the world, returns the measurements of blocks of firings.

Revolution i covers the sim time from i / rate to (i + 1) / rate. It is measured when the state at
or after its end has come; a block, when the state after its last ray has come. All blocks together
equal the whole revolution. Each ray leaves from the sensor's pose at its own instant, and hits all
vehicles, its own too, where they are at that instant.

A block is left out and marked when, by the number of waiting states, it is due again already. A
surface nearer than the minimum range gives no return and hides what is behind it.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.core.frames import Floats
from groundlink.messages.base import BadBusMessage, State
from groundlink.messages.reading_schedule import Blocks
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.cover.ground_cover import ground_cover
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.replica import Replica
from services.sensors.rays.scene import Reals
from services.sensors.runtime.model import LeftOut

from .beams import Beams
from .draws import RevolutionDraws
from .foreign_light import foreign_light
from .returns import LidarReceiver, Returns
from .stray_light import StrayLight
from .sweep import Sweep
from .truth import Cast, TrueReturns, TrueView
from .weather import atmosphere_of


class FiringBlocks(Blocks):
    """The blocks of firings in which the revolutions of one LiDAR are sent.

    All but the last block of a revolution end with their last ray, which may leave after the next
    firing has begun. The last block ends where the next revolution begins, or with its last ray if
    the head does not fire until then.

    Parameters
    ----------
    spec : RotatingLidar
    sweep : Sweep
    neighbors : int
        Firings before and after a firing, in its revolution, whose hits it depends on.
    """

    def __init__(self, spec: RotatingLidar, sweep: Sweep, neighbors: int = 0) -> None:
        super().__init__(spec)
        self._neighbors = neighbors
        self._late_nanos = round(sweep.latest_seconds * NANOS)

    def since_start(self, seconds: Floats) -> Reals:
        """Convert instants since the revolution's start to instants since the block's start.

        Parameters
        ----------
        seconds : float64 array, shape (lasers, firings)
        """
        starts = np.array(self.first_firings[:-1]) / float(self.firing_times.rate_hz)
        return (seconds - np.repeat(starts, np.diff(self.first_firings))).astype(np.float32)

    def firings(self, blocks: range) -> tuple[int, range]:
        """Return the revolution of some blocks and their firings in it."""
        revolution, index = divmod(blocks.start, self.per_revolution)
        first = self.first_firings
        return revolution, range(first[index], first[index + len(blocks)])

    def cast(self, firings: range) -> range:
        """Return the firings of a revolution that some firings of it depend on."""
        first, last = self.first_firings[0], self.first_firings[-1]
        return range(
            max(first, firings.start - self._neighbors), min(last, firings.stop + self._neighbors)
        )

    def first_tick(self, block: int) -> int:
        """Return the last tick that is not after the first firing that a block depends on."""
        revolution, own = self.firings(range(block, block + 1))
        first = revolution * self.firings_per_turn + self.cast(own).start
        return self.firing_times.nanos(first) // TICK_NANOS

    def after(self, nanos: int) -> int:
        """Return the first block that depends on no firing before a sim time."""
        block = self.at_or_after(nanos)
        while self.first_tick(block) * TICK_NANOS < nanos // TICK_NANOS * TICK_NANOS:
            block += 1
        return block

    def end_tick(self, block: int) -> int:
        """Return the tick whose state completes a block."""
        revolution, index = divmod(block, self.per_revolution)
        after = revolution * self.firings_per_turn + self.first_firings[index + 1]
        end = self.firing_times.tick(after)
        if after % self.firings_per_turn == 0:
            return end
        in_turn = self.cast(range(after % self.firings_per_turn)).stop
        last = revolution * self.firings_per_turn + in_turn - 1
        latest = self.firing_times.nanos(last) + self._late_nanos
        return max(end, -(-latest // TICK_NANOS))

    def complete_by(self, tick: int, block: int) -> int:
        """Return the end of the blocks from `block` on that a tick's state completes.

        They belong to the revolution of `block`, which is complete.
        """
        last = (block // self.per_revolution + 1) * self.per_revolution
        end = block + 1
        while end < last and self.end_tick(end) <= tick:
            end += 1
        return end


class Scan(NamedTuple):
    """One block of firings, measured."""

    nanos: int
    """Sim time of its first firing, rounded down."""

    revolution: int
    firings: range
    """Firings of the revolution."""

    directions_in_sensor: Reals
    """`Sweep.directions_in_sensor` of the revolution."""

    returns: Returns
    """Returns of these firings."""

    truth: TrueReturns | None
    """Ground truth of these returns, if enabled."""

    poses: Floats | None
    """World_from_link at `nanos`, shape (links, 7), if labels are enabled."""


class Scanner:
    """A rotating LiDAR on a vehicle.

    Attributes
    ----------
    sweep : Sweep
    blocks : FiringBlocks
    replica : Replica
    receiver : Receiver

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed here.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: RotatingLidar,
        sweep: Sweep,
        *,
        truth: bool = False,
        labels: bool = False,
    ) -> None:
        self._has_labels = labels
        self._max_range_m = spec.max_range_m
        self._schedule = Schedule.at(spec.rotation_rate_hz)
        self.sweep = sweep
        stray = StrayLight(spec, self.sweep.rings)
        self.blocks = FiringBlocks(spec, self.sweep, stray.neighbors)
        self.replica = Replica(scenario, vehicle, spec.mount)
        self._true_view = TrueView(self.replica, spec.mount) if truth else None
        streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        draws = RevolutionDraws(streams)
        self._beams = Beams(spec, self.sweep, draws)
        self._cover, self._draws = ground_cover(scenario, self.replica), draws
        reflectance = self._cover.reflectance if self._cover else self.replica.reflectivity
        air = atmosphere_of(spec, scenario.world.weather)
        self.receiver = LidarReceiver(
            *(spec, self.sweep, reflectance, air, stray),
            *(foreign_light(scenario, spec), streams, draws),
        )
        self._waiting = 0
        self.restart()

    def behind(self, waiting: int) -> None:
        """Record how many more states have arrived."""
        self._waiting = waiting

    def restart(self) -> None:
        """Forget earlier states; measure from the next block on."""
        self.replica.restart()
        self._block = self._tick = self._first_tick = self._end_tick = -1

    def settled_tick(self) -> int:
        """Return the tick at which the present block began; -1 before the first state."""
        if self._block < 0:
            return -1
        return min(self._tick, self._first_tick)

    def take(self, state: State) -> list[Scan | LeftOut]:
        """Take the state of the next tick and return the blocks that it completes, oldest first.

        Raises
        ------
        BadBusMessage
            when the state lacks a vehicle or a link of the scenario; everything is then restarted.
        """
        try:
            self.replica.take(state)
        except BadBusMessage:
            self.restart()
            raise
        self._tick = state.tick
        if self._block < 0:
            self._begin(self.blocks.after(state.tick * TICK_NANOS))
        scans: list[Scan | LeftOut] = []
        while self._end_tick <= state.tick:
            blocks = range(self._block, self.blocks.complete_by(state.tick, self._block))
            again_tick = self.blocks.end_tick(self._block + self.blocks.per_revolution)
            if again_tick <= state.tick + self._waiting:
                scans += [LeftOut(self.blocks.nanos(block), "overloaded") for block in blocks]
            else:
                scans += self._scans(blocks)
            self._begin(blocks.stop)
        return scans

    def _begin(self, block: int) -> None:
        self._block, self._end_tick = block, self.blocks.end_tick(block)
        self._first_tick = self.blocks.first_tick(block)
        self.replica.forget(self._first_tick)

    def _scans(self, blocks: range) -> list[Scan]:
        """Measure blocks of one revolution, with one cast."""
        revolution, firings = self.blocks.firings(blocks)
        firings = self.blocks.cast(firings)
        cast = self.measure(revolution, firings)
        scans = []
        for block in blocks:
            _, own = self.blocks.firings(range(block, block + 1))
            of_cast = slice(own.start - firings.start, own.stop - firings.start)
            nanos, truth = self.blocks.nanos(block), None
            if self._true_view is not None:
                truth = self._true_view.see(cast, of_cast, nanos)
            poses = self.replica.at(nanos) if self._has_labels else None
            of_rays = own, self.sweep.directions_in_sensor
            scans.append(Scan(nanos, revolution, *of_rays, cast.returns.of(of_cast), truth, poses))
        return scans

    def measure(self, revolution: int, firings: range) -> Cast:
        """Return the measurements of firings of a revolution."""
        start_nanos = self._schedule.nanos(revolution)
        first_tick = start_nanos // TICK_NANOS
        # States of the whole revolution, so that times are the same numbers in every block.
        poses = self.replica.motion(first_tick, self._schedule.tick(revolution + 1))
        start_seconds = (start_nanos - first_tick * TICK_NANOS) / NANOS
        tick = self._schedule.tick(revolution)
        # As at the revolution's start, so that all of its blocks have the same ground.
        self.replica.press(first_tick)
        self.sweep.aim(revolution)
        self.sweep.follow(poses[:, self.replica.carrier], start_seconds, firings)
        self.replica.scene.move(poses)
        rays = self._beams.rays(firings, tick)
        hits = self.replica.scene.cast(*rays, self._max_range_m)
        if self._cover:
            draws = self._leaves(tick, firings, rays.times.shape) if self._cover.has_grass else None
            self._cover.meet(hits, rays, draws, poses, self._max_range_m)
        returns = self.receiver.measure(hits, rays, firings, tick)
        return Cast(returns, rays, hits, poses, first_tick)

    def _leaves(self, tick: int, firings: range, shape: tuple[int, ...]) -> Reals:
        """Return two random numbers of each ray of some firings for the grass that it meets."""
        whole = (2, shape[0], self.sweep.seconds.shape[1], *shape[2:])
        drawn = self._draws.of("grass", tick, lambda source: source.random(whole, np.float32))
        return drawn[:, :, firings.start : firings.stop]
