# SPDX-License-Identifier: Apache-2.0
"""Measurement model of a depth camera: noise and holes of a stereo pair, and range limits.

The input and the output are depth along z of the optical frame; the caller supplies the random
generator. Values follow REP 117 and 118: -inf for too near, +inf beyond the largest range and in
the sky, NaN where no depth is found. A stereo pair finds depth by matching each pixel of the left
eye with a pixel in the same row of the right eye, `disparity` = f baseline / z columns to the left.
The effect of texture on matching is not modeled.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.sensors import DepthCamera

Reals = NDArray[np.float32]
Flags = NDArray[np.bool_]

JUMP_PX = 1.0
"""Neighboring pixels whose disparities differ by more belong to two surfaces."""


def measured(truth_m: Reals, fx: float, spec: DepthCamera, generator: np.random.Generator) -> Reals:
    """Return the measured depth for true depth, shape (height, width), infinite in the sky.

    Disparity noise of standard deviation s causes depth noise of standard deviation z^2 / (f
    baseline) s.
    """
    depth_m = truth_m.copy()
    if spec.baseline_m:
        scale = np.float32(fx * spec.baseline_m)
        disparity_px = scale / truth_m
        lost = unseen_by_right_eye(disparity_px)
        if spec.edge_holes_px:
            lost |= near_jumps(disparity_px, spec.edge_holes_px)
        if spec.disparity_stddev_px:
            noise = generator.standard_normal(truth_m.shape, np.float32)
            noisy = disparity_px + np.float32(spec.disparity_stddev_px) * noise
            matched = (noisy > 0) & (disparity_px > 0)
            np.divide(scale, noisy, out=depth_m, where=matched)
            depth_m[~matched] = np.inf
        depth_m[lost] = np.nan
    depth_m[depth_m > np.float32(spec.max_range_m)] = np.inf
    depth_m[depth_m < np.float32(spec.min_range_m)] = -np.inf
    return depth_m


def unseen_by_right_eye(disparity_px: Reals) -> Flags:
    """Return the pixels of the left eye whose points the right eye does not see.

    A point appears in column x - disparity of the right eye. It is hidden if a point to its right
    in the left picture appears at least as far left, as a nearer point does. A band along the left
    rim of the left picture is outside of the right picture.
    """
    columns = np.arange(disparity_px.shape[1], dtype=np.float32)
    there = columns - disparity_px
    leftmost = np.minimum.accumulate(there[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(there.shape, bool)
    hidden[:, :-1] = leftmost[:, 1:] <= there[:, :-1]
    return hidden | (there < -0.5)


def near_jumps(disparity_px: Reals, radius_px: int) -> Flags:
    """Return the pixels within a square of half width `radius_px` around a disparity jump."""
    jumps = np.zeros(disparity_px.shape, np.uint8)
    across = np.abs(np.diff(disparity_px, axis=1)) > JUMP_PX
    down = np.abs(np.diff(disparity_px, axis=0)) > JUMP_PX
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down
    window = np.ones((2 * radius_px - 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(jumps, window)).astype(bool)
