// SPDX-License-Identifier: Apache-2.0
/* Standing water around a vehicle; `water.py` fills these structures and documents them. All vectors
 * are in the base frame unless a comment says otherwise.
 */

#ifndef GROUNDLINK_WATER_H
#define GROUNDLINK_WATER_H

#include "../running_gear/running_gear.h"

struct water_area {
    double low[2], high[2]; /* in the world */
    double level;
};

struct wading_wheel {
    double width, drag_share, tightness;
};

struct wading {
    const struct water_area *areas;
    size_t area_count;
    const struct wading_wheel *wheels;
    double low[3], high[3]; /* of the box of the hull */
    double tightness;
    double limit; /* infinite: none */
    double depth, drowned;
};

#endif
