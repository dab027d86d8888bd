// SPDX-License-Identifier: Apache-2.0
/* Interpolation in a table of soil; see `table.py`. */

#include "table.h"

/* Return the place of the interval of a rising axis that a value is in, or the nearest. */
static size_t interval(const double *axis, size_t count, double value)
{
    size_t low = 0, high = count - 1;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (axis[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static void add(struct soil_row *sum, double weight, const struct soil_row *row)
{
    sum->sinkage += weight * row->sinkage;
    sum->thrust += weight * row->thrust;
    sum->resistance += weight * row->resistance;
    sum->side += weight * row->side;
}

void groundlink_soil_table_at(const struct soil_table *table, double load, double slip, double rut,
                              struct soil_response *response)
{
    const double *loads = table->loads, *slips = table->slips;
    double scale = 1.0;
    if (load < loads[0]) {
        scale = load / loads[0];
        load = loads[0];
    }
    size_t i = interval(loads, table->load_count, load);
    size_t k = interval(slips, table->slip_count, slip);
    double place = rut / table->deepest_rut * (table->rut_count - 1);
    size_t j = (size_t)place < table->rut_count - 2 ? (size_t)place : table->rut_count - 2;
    double a = (load - loads[i]) / (loads[i + 1] - loads[i]);
    double b = place - j;
    double c = (slip - slips[k]) / (slips[k + 1] - slips[k]);
    *response = (struct soil_response){0};
    for (size_t corner = 0; corner < 4; corner++) {
        size_t more_load = corner >> 1, deeper = corner & 1;
        double weight = scale * (more_load ? a : 1.0 - a) * (deeper ? b : 1.0 - b);
        size_t first = (i + more_load) * table->rut_count + j + deeper;
        const struct soil_row *row = table->rows + first * table->slip_count;
        add(&response->now, weight * (1.0 - c), row + k);
        add(&response->now, weight * c, row + k + 1);
        response->free += weight * row[table->slip_count / 2].thrust;
        response->most += weight * row[table->slip_count - 1].thrust;
    }
}
