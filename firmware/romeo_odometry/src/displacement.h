// The displacement frames: when the next is due, and what stands in it. Pure.
#pragma once

#include <stdint.h>

#include "odometry.h"
#include "protocol.h"
#include "wheels.h"

class DisplacementReports {
public:
    // Is a frame due at `now` (micros(), modulo 2^32)? Each is told once.
    bool due(uint32_t now_us, uint8_t report_rate_hz);

    // The wheels have this geometry from these counts on.
    void configure(const settings_frame &settings, Wheels<int32_t> ticks);

    // The next frame of the sequence, of counters that stood so at `time_us`.
    displacement_frame make(uint32_t time_us, Wheels<int32_t> ticks);

private:
    odometry::Odometry odometry;
    uint32_t last_due_us = 0;
    uint16_t sequence = 0;
};
