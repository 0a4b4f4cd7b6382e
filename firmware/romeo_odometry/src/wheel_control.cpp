#include "wheel_control.h"

#include <Arduino.h>
#include <avr/cpufunc.h>
#include <util/atomic.h>

#include "encoders.h"
#include "motors.h"
#include "runaway.h"
#include "speed_control.h"
#include "tick_counter.h"

namespace {

constexpr uint16_t PERIOD = F_CPU / 256 / CONTROL_HZ; // in counts of timer 1
constexpr uint8_t TIMEOUT_PERIODS = PROTOCOL_COMMAND_TIMEOUT_MS / (1000 / CONTROL_HZ);
// Before the first command there is nothing to time out.
constexpr uint8_t NO_COMMAND = UINT8_MAX;
static_assert(TIMEOUT_PERIODS < NO_COMMAND - 1, "the command's age must fit a byte");

struct Wheel {
    SpeedControl control;
    RunawayDetector runaway;
    EdgeCounts last;
    bool ran_away;

    // The duty for the next period.
    int16_t step(uint8_t periods, int32_t ticks, const EdgeCounts &edges) {
        const int16_t duty = control.step(ticks, motors::FULL_DUTY);
        const EdgeCounts new_edges = edges.since(last);
        last = edges;
        if (duty != 0 && (runaway.step(periods, ticks, control.asked(), duty, motors::FULL_DUTY) |
                          runaway.listen(periods, new_edges))) {
            ran_away = true;
        }
        return duty;
    }
};

Wheels<Wheel> wheels;
TickCounter position;
volatile bool running_away; // one of them: both are off
volatile uint8_t command_age = NO_COMMAND; // periods; stays at TIMEOUT_PERIODS + 1
volatile bool run_since_asked; // in time

bool has_timed_out() { return command_age != NO_COMMAND && command_age > TIMEOUT_PERIODS; }

void stop_both() {
    wheels.left.control.stop();
    wheels.right.control.stop();
}

void grow_older(uint8_t periods) {
    if (command_age <= TIMEOUT_PERIODS) {
        command_age = periods > TIMEOUT_PERIODS - command_age ? TIMEOUT_PERIODS + 1
                                                              : command_age + periods;
        if (has_timed_out()) {
            stop_both();
        }
    }
}

// How many periods have passed since the last call; the next interrupt comes at the end of the next.
// By the timer's count, which goes on where edges keep this interrupt waiting.
uint8_t periods_passed() {
    const uint16_t now = TCNT1;
    uint16_t next = OCR1A;
    uint8_t periods = 0;
    do {
        next += PERIOD;
        ++periods;
    } while (static_cast<int16_t>(next - now) <= 0);
    OCR1A = next;
    return periods;
}

void step(uint8_t periods, const Wheels<EdgeCounts> &edges) {
    grow_older(periods);
    const Wheels<int32_t> ticks = position.count(edges);
    Wheels<int16_t> duty = {wheels.left.step(periods, ticks.left, edges.left),
                            wheels.right.step(periods, ticks.right, edges.right)};
    if (wheels.left.ran_away || wheels.right.ran_away) {
        running_away = true;
        stop_both();
        duty = {0, 0};
    }
    motors::drive(duty);
    if (periods == 1) {
        run_since_asked = true;
    }
}

} // namespace

// A step takes longer than encoders may wait, so interrupts are on in it, but for its own: one that
// edges slow down would pile up on itself.
ISR(TIMER1_COMPA_vect, ISR_NOBLOCK) {
    TIMSK1 &= ~_BV(OCIE1A);
    const uint8_t periods = periods_passed();
    Wheels<EdgeCounts> edges;
    ATOMIC_BLOCK(ATOMIC_FORCEON) {
        edges = encoders::counts();
    }
    step(periods, edges);
    cli();
    TIMSK1 |= _BV(OCIE1A);
}

void wheel_control::begin() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        TCCR1A = 0;
        TCCR1B = _BV(CS12); // runs over after 1.05 s, long after the watchdog; clock / 256
        TCNT1 = 0;
        OCR1A = PERIOD;
        TIFR1 = _BV(OCF1A);
    }
}

void wheel_control::configure(const settings_frame &settings) {
    // Only the control waits meanwhile: its divisions are too long for the encoders to. The barriers
    // keep the compiler from moving them to before or after.
    TIMSK1 &= ~_BV(OCIE1A);
    _MemoryBarrier();
    position.reverse(settings.reversed);
    wheels.left.control.configure(settings);
    wheels.right.control.configure(settings);
    wheels.left.runaway.configure(settings);
    wheels.right.runaway.configure(settings);
    _MemoryBarrier();
    TIMSK1 |= _BV(OCIE1A);
}

void wheel_control::command(Wheels<int16_t> ticks_per_s) {
    const bool stopping = ticks_per_s.left == 0 && ticks_per_s.right == 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (stopping) {
            running_away = wheels.left.ran_away = wheels.right.ran_away = false;
            wheels.left.runaway.restart();
            wheels.right.runaway.restart();
        }
        if (!running_away) {
            wheels.left.control.aim(ticks_per_s.left);
            wheels.right.control.aim(ticks_per_s.right);
        }
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

Wheels<bool> wheel_control::ran_away() {
    return {wheels.left.ran_away, wheels.right.ran_away};
}

bool wheel_control::has_run() {
    const bool has = run_since_asked;
    run_since_asked = false;
    return has;
}
