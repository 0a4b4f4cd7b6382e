#include "wheel_control.h"

#include <Arduino.h>
#include <avr/cpufunc.h>
#include <util/atomic.h>

#include "encoders.h"
#include "motors.h"
#include "speed_control.h"

namespace {

constexpr uint8_t TIMEOUT_PERIODS = PROTOCOL_COMMAND_TIMEOUT_MS / (1000 / CONTROL_HZ);
// Before the first command there is nothing to time out.
constexpr uint8_t NO_COMMAND = UINT8_MAX;
static_assert(TIMEOUT_PERIODS < NO_COMMAND - 1, "the command's age must fit a byte");

Wheels<SpeedControl> controls;
volatile uint8_t command_age = NO_COMMAND; // periods; stays at TIMEOUT_PERIODS + 1

bool has_timed_out() { return command_age != NO_COMMAND && command_age > TIMEOUT_PERIODS; }

void stop_both() {
    controls.left.stop();
    controls.right.stop();
}

void grow_older() {
    if (command_age <= TIMEOUT_PERIODS) {
        ++command_age;
        if (has_timed_out()) {
            stop_both();
        }
    }
}

} // namespace

// Interrupts stay on: a control step takes longer than encoders may wait.
ISR(TIMER1_COMPA_vect, ISR_NOBLOCK) {
    Wheels<int32_t> position;
    ATOMIC_BLOCK(ATOMIC_FORCEON) {
        position = encoders::read();
    }
    grow_older();
    motors::drive({controls.left.step(position.left, motors::FULL_DUTY),
                   controls.right.step(position.right, motors::FULL_DUTY)});
}

void wheel_control::begin() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        TCCR1A = 0;
        TCCR1B = _BV(WGM12) | _BV(CS11) | _BV(CS10); // up to OCR1A, clock / 64
        OCR1A = F_CPU / 64 / CONTROL_HZ - 1;
        TCNT1 = 0;
        TIFR1 = _BV(OCF1A);
    }
}

void wheel_control::configure(const settings_frame &settings) {
    // Only the control waits meanwhile: its divisions are too long for the encoders to. The barriers
    // keep the compiler from moving them to before or after.
    TIMSK1 &= ~_BV(OCIE1A);
    _MemoryBarrier();
    controls.left.configure(settings);
    controls.right.configure(settings);
    _MemoryBarrier();
    TIMSK1 |= _BV(OCIE1A);
}

void wheel_control::command(Wheels<int16_t> ticks_per_s) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        controls.left.want(ticks_per_s.left);
        controls.right.want(ticks_per_s.right);
        command_age = 0;
    }
}

void wheel_control::stop() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        stop_both();
    }
}

bool wheel_control::timed_out() {
    return has_timed_out();
}
