// SPDX-License-Identifier: Apache-2.0
/* Ruts in the making; `ruts.py` fills the structure. */

#ifndef GROUNDLINK_SOIL_RUTS_H
#define GROUNDLINK_SOIL_RUTS_H

#include "../../../groundlink/world/ruts.h"

struct ruts {
    struct rut_grid grid;
    uint8_t *is_pending;
    int32_t *pending; /* tiles that have changed since they were published */
    size_t pending_count;
    int32_t is_full;
};

/* Press the ground under a wheel at a point as deep as it has sunk, along the way of a tick. */
void groundlink_ruts_press(struct ruts *, const double at[2], const double heading[2],
                           double width, double radius, double depth, double way);

/* Return half the length in which a wheel meets soil. */
double groundlink_ruts_contact(double radius, double depth);

/* Return the mean depth on a strip of two cells across the way of a wheel. */
double groundlink_ruts_mean(const struct ruts *, const double at[2], const double heading[2],
                            double width);

#endif
