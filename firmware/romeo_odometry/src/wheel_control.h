// The wheels' speeds, held by a timer interrupt that no stuck loop can stop.
#pragma once

#include "protocol.h"
#include "wheels.h"

namespace wheel_control {

void begin();

// From the first settings on the control runs.
void configure(const settings_frame &settings);

// Wanted speeds, ticks/s. In force until the next ones or the command timeout.
void command(Wheels<int16_t> ticks_per_s);

// Let go of both wheels; the next command is followed from a standstill.
void stop();

// Is the last command older than the command timeout?
bool timed_out();

} // namespace wheel_control
