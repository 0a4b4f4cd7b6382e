// Running distance and heading from encoder ticks: Perera 2021, eq. 31 and 32. Pure.
//
// Integers only. A tick adds a constant to a sum of 64 bits, whose upper half is what is reported: the
// sum has no rounding error, and where it runs over, so does the report. What is left is the rounding
// of the constants, 2^-33 um or urad a tick at most: a quarter of a unit in 2^31 ticks of a wheel.
#pragma once

#include <stdint.h>

#include "protocol.h"
#include "wheels.h"

namespace odometry {

class Odometry {
public:
    // Settings within their bounds, for the ticks from now on.
    void configure(const settings_frame &settings);

    // The wheels stand at these counts (modulo 2^32). They begin at 0.
    void __attribute__((noinline)) advance(Wheels<int32_t> ticks);

    // um, forward positive, modulo 2^32.
    int32_t distance() const { return static_cast<int32_t>(distance_sum >> 32); }

    // urad, counter-clockwise positive, modulo 2^32.
    int32_t heading() const { return static_cast<int32_t>(heading_sum >> 32); }

private:
    static constexpr uint64_t HALF = 1ULL << 31; // rounds the upper halves, which are cut, to nearest

    Wheels<int32_t> last = {0, 0};
    // In 2^-32 um and 2^-32 urad; unsigned, because they run over and that is no error.
    Wheels<uint64_t> distance_a_tick = {0, 0};
    Wheels<uint64_t> heading_a_tick = {0, 0};
    uint64_t distance_sum = HALF;
    uint64_t heading_sum = HALF;
};

} // namespace odometry
