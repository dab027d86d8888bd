// SPDX-License-Identifier: Apache-2.0
/* Motors and batteries; see `motor.py`. */

#include <math.h>

#include "running_gear.h"

static double within(double value, double most)
{
    value = value < most ? value : most;
    return value > 0.0 ? value : 0.0;
}

void groundlink_motors_limits(const struct motors *motors, double speed, double share,
                              double limits[2])
{
    if (motors->stall == 0.0) {
        limits[0] = share > 0.0 ? -motors->most : 0.0;
        limits[1] = share > 0.0 ? motors->most : 0.0;
        return;
    }
    double slowing = speed / motors->no_load_speed;
    limits[0] = -within(motors->stall * (share + slowing), motors->most);
    limits[1] = within(motors->stall * (share - slowing), motors->most);
}

double groundlink_motors_power(const struct motors *motors, double torque, double speed)
{
    double power = torque * speed;
    if (motors->stall != 0.0)
        power += torque * torque * motors->no_load_speed / motors->stall;
    return power > 0.0 ? power : 0.0;
}

double groundlink_battery_draw(struct battery *battery, double power)
{
    if (battery->share <= 0.0) {
        battery->current = battery->voltage = 0.0;
        return 0.0;
    }
    double volts = battery->empty + battery->share * (battery->full - battery->empty);
    double ohms = battery->resistance;
    power += battery->idle_power;
    if (ohms > 0.0)
        battery->current = (volts - sqrt(fmax(0.0, volts * volts - 4 * ohms * power))) / (2 * ohms);
    else
        battery->current = power / volts;
    double used = battery->current * TICK_SECONDS / 3600 / battery->capacity_ah;
    battery->share = fmax(0.0, battery->share - used);
    battery->voltage = volts - battery->current * ohms;
    return battery->voltage / battery->full;
}
