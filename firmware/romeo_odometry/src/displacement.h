// The displacement frames: when the next is due, and what stands in it. Pure.
//
// The board reports running counts; how far that is and how much of a turn (Perera 2021, eq. 31
// and 32) the host works out, because wheel radii, track and counts per turn stand in robot.toml.
#pragma once

#include <stdint.h>

#include "protocol.h"
#include "wheels.h"

class DisplacementReports {
public:
    // Is a frame due at `now` (micros(), modulo 2^32)? Each is told once.
    bool due(uint32_t now_us, uint8_t report_rate_hz);

    // The next frame of the sequence, of counters that stood so at `time_us`.
    displacement_frame make(uint32_t time_us, Wheels<int32_t> ticks);

private:
    uint32_t last_due_us = 0;
    uint16_t sequence = 0;
};
