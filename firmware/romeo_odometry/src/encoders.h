// How far the wheels have turned, counted edge by edge in interrupts.
#pragma once

#include <stdint.h>

#include "wheels.h"

namespace encoders {

void begin();

// SETTINGS_REVERSED_ bits: which encoders count down when driving forward. The counts so far stay.
void reverse(uint8_t reversed);

// Ticks since start, forward positive, modulo 2^32. Call with interrupts off, so that both counts
// are of one instant.
Wheels<int32_t> read();

} // namespace encoders
