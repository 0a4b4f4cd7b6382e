#include "speed_control.h"

namespace {

int32_t clipped(int32_t value, int32_t most) {
    return value > most ? most : value < -most ? -most : value;
}

} // namespace

void SpeedControl::configure(const settings_frame &settings) {
    full_output = 16L * settings.full_speed;
    proportional = settings.proportional;
    integral = settings.integral;
    most_change = settings.acceleration / CONTROL_HZ;
    most_lag = integral ? full_output / 4 * CONTROL_HZ / integral : 0;
    lag = clipped(lag, most_lag);
}

void SpeedControl::stop() {
    target = 0;
    reference = 0;
}

void SpeedControl::ramp() {
    reference += static_cast<int16_t>(clipped(static_cast<int32_t>(target) - reference, most_change));
}

int16_t SpeedControl::step(int32_t position, int16_t full_duty) {
    // Unsigned, because the count runs over and that is no error.
    const int32_t moved =
        static_cast<int32_t>(static_cast<uint32_t>(position) - static_cast<uint32_t>(last));
    last = position;
    ramp();
    if (reference == 0) {
        lag = 0;
        return 0;
    }
    // The sum of speed errors is the wheel's lag in ticks, in which the coarse speed of one period
    // (a tick is 100 ticks/s) leaves no error.
    const int32_t error = reference - clipped(moved, INT16_MAX / CONTROL_HZ) * CONTROL_HZ;
    const int32_t next_lag = clipped(lag + error, most_lag);
    const int32_t output = 16L * reference + proportional * error + integral * next_lag / CONTROL_HZ;
    // While the duty is at its end, as of a blocked wheel, more lag would only be paid back later.
    const bool winding_up = (output > full_output && error > 0) || (output < -full_output && error < 0);
    if (!winding_up) {
        lag = next_lag;
    }
    return static_cast<int16_t>(clipped(output, full_output) * full_duty / full_output);
}
