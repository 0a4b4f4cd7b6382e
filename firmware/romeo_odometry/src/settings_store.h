// The settings in force, and their copy in EEPROM.
#pragma once

#include "protocol.h"

namespace settings_store {

// Read the EEPROM; where it holds nothing whole, the defaults are in force.
void begin();

const settings_frame &in_force();

// Were the stored settings missing or damaged, and nothing has been written since?
bool defaulted();

// Use these, within their bounds, from now on and after the next start.
void write(const settings_frame &wanted);

// Write at most one byte that has changed: one takes 3.4 ms, and nobody waits for it.
void step();

} // namespace settings_store
