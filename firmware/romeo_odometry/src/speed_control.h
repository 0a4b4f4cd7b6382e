// From a target wheel speed and the ticks counted to a duty: feed-forward and PI. Pure.
#pragma once

#include <stdint.h>

#include "protocol.h"

constexpr int16_t CONTROL_HZ = 100;

class SpeedControl {
public:
    // Settings within their bounds. The wheel's state stays.
    void configure(const settings_frame &settings);

    // The speed to reach, ticks/s, forward positive.
    void aim(int16_t ticks_per_s) { target = ticks_per_s; }

    // Forget the target: the duty is 0 from the next step on.
    void stop();

    // The speed asked for in the last period: the target, but for the ramp.
    int16_t asked() const { return reference; }

    // One period of 1 / CONTROL_HZ has passed and the wheel stands at `position` (ticks, modulo
    // 2^32): the duty for the next, from -full_duty to full_duty.
    int16_t step(int32_t position, int16_t full_duty);

private:
    void ramp();

    int16_t target = 0;
    // Gains as in settings_frame; full_duty is reached where their sum reaches `full_output`.
    int32_t full_output = 1; // 16 * full_speed
    uint8_t proportional = 0;
    uint8_t integral = 0;
    uint16_t most_change = 0; // of the reference in one period, ticks/s

    int16_t reference = 0; // the target, followed no faster than the acceleration allows
    int32_t lag = 0;       // how far the wheel is behind the reference, 1 / CONTROL_HZ ticks
    int32_t most_lag = 0;  // where the integral part alone gives a quarter of full duty
    int32_t last = 0;      // position one period ago
};
