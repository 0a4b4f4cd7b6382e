// The displacement frames: when the next is due, and what stands in it.
//
// The board reports running counts; how far that is and how much of a turn (Perera 2021, eq. 31
// and 32) the host works out, because wheel radii, track and counts per turn stand in robot.toml.
#pragma once

#include <stdint.h>

#include "protocol.h"

namespace displacement {

// Is a frame due at `now` (micros())? Each is asked for once.
bool due(uint32_t now_us, uint8_t report_rate_hz);

// Counters and their time, of one instant, with the next number of the sequence.
displacement_frame measure();

} // namespace displacement
