// The wheels' speeds, held by a timer interrupt that no stuck loop can stop.
#pragma once

#include "protocol.h"
#include "wheels.h"

namespace wheel_control {

void begin();

// From the first settings on the control runs.
void configure(const settings_frame &settings);

// Target speeds, ticks/s. In force until the next ones or the command timeout. Both 0 is the stop
// command: it ends the runaway state, in which no other is followed.
void command(Wheels<int16_t> ticks_per_s);

// Let go of both wheels; the next command is followed from a standstill.
void stop();

// Is the last command older than the command timeout?
bool timed_out();

// The wheels that did not follow their motors (RunawayDetector), until the next stop command.
Wheels<bool> ran_away();

// Has the control run in time since this was asked last? Edges without end leave it none.
bool has_run();

} // namespace wheel_control
