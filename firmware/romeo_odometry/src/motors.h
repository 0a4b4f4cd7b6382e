// The motor driver's pins.
#pragma once

#include <stdint.h>

#include "wheels.h"

namespace motors {

constexpr int16_t FULL_DUTY = 255;

void begin();

// SETTINGS_REVERSED_ bits: which motors drive backward at a high level of their direction pin.
void reverse(uint8_t reversed);

// Duties from -FULL_DUTY to FULL_DUTY, forward positive; at 0 the wheel runs out freely. Called
// from the control interrupt alone.
void drive(Wheels<int16_t> duty);

} // namespace motors
