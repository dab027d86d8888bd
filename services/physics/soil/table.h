// SPDX-License-Identifier: Apache-2.0
/* Tables of what soil does to a wheel; `table.py` makes them and documents units. */

#ifndef GROUNDLINK_SOIL_TABLE_H
#define GROUNDLINK_SOIL_TABLE_H

#include <stddef.h>

struct soil_row {
    double sinkage, thrust, resistance, side;
};

struct soil_table {
    const double *loads, *slips;
    const struct soil_row *rows; /* by load, rut and slip */
    size_t load_count, rut_count, slip_count;
    double deepest_rut; /* the last of evenly spaced ones, from none */
};

struct soil_response {
    struct soil_row now;
    double free, most; /* thrust without slip, and of a wheel that spins in place */
};

void groundlink_soil_table_at(const struct soil_table *, double load, double slip, double rut,
                              struct soil_response *);

#endif
