// The encoders' edges, counted in interrupts.
#pragma once

#include "tick_counter.h"
#include "wheels.h"

namespace encoders {

void begin();

// Call with interrupts off, so that both wheels' counts are of one instant.
Wheels<EdgeCounts> counts();

} // namespace encoders
