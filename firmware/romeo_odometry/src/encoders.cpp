#include "encoders.h"

#include <Arduino.h>
#include <util/atomic.h>

#include "wiring.h"

namespace {

// Short counts, because each cycle of an edge keeps the next one waiting.
struct Encoder {
    volatile uint16_t forward;
    volatile uint16_t backward;
    volatile uint16_t illegal;

    void count(bool is_forward) {
        if (is_forward) {
            ++forward;
        } else {
            ++backward;
        }
    }

    EdgeCounts counts() const { return {forward, backward, illegal}; }
};

Encoder left;
Encoder right;

// The levels are read from the ports themselves: digitalRead takes 3 us, time for the next edge.
static_assert(LEFT_ENCODER_B_PIN == 9 && RIGHT_ENCODER_B_PIN == 11, "are PB5 and PB7 below");

} // namespace

#if ENCODER_EDGES == 2

static_assert(LEFT_ENCODER_A_PIN == 2 && RIGHT_ENCODER_A_PIN == 3, "are PD1 and PD0, INT1 and INT0");

namespace {

bool left_was_high;
bool right_was_high;

// From A's edge to its settled level: 5 us, of which the interrupt has taken 2.
constexpr uint8_t SETTLING_CYCLES = 64;

// An edge of A: the channels differ after it when A is ahead, and are equal when B is. Where A is as
// it was, there were two: a pulse too short for any wheel, or edges faster than this can count. Where
// the next edge is here already, the interrupt looks again: noise on both leads at once would change
// both channels, and count like two edges of a wheel.
inline void edge(Encoder &encoder, bool &was_high, bool a, bool b, uint8_t flag) {
    if (a == was_high) {
        ++encoder.illegal;
        return;
    }
    __builtin_avr_delay_cycles(SETTLING_CYCLES);
    if (EIFR & flag) {
        return;
    }
    was_high = a;
    encoder.count(a != b);
}

} // namespace

ISR(INT1_vect) { edge(left, left_was_high, PIND & _BV(PD1), PINB & _BV(PB5), _BV(INTF1)); }
ISR(INT0_vect) { edge(right, right_was_high, PIND & _BV(PD0), PINB & _BV(PB7), _BV(INTF0)); }

static void enable_interrupts() {
    EICRA |= _BV(ISC00) | _BV(ISC10); // on any change
    EICRA &= ~(_BV(ISC01) | _BV(ISC11));
    left_was_high = PIND & _BV(PD1);
    right_was_high = PIND & _BV(PD0);
    EIFR = _BV(INTF0) | _BV(INTF1);
    EIMSK |= _BV(INT0) | _BV(INT1);
}

#else

static_assert(LEFT_ENCODER_A_PIN == 8 && RIGHT_ENCODER_A_PIN == 10, "are PB4 and PB6, PCINT4 and 6");

namespace {

constexpr uint8_t CHANNELS = _BV(PB4) | _BV(PB5) | _BV(PB6) | _BV(PB7);

volatile uint8_t levels;
volatile bool more_came; // an edge after the last look's interrupt began: that look may have seen it

inline bool left_a(uint8_t port) { return port & _BV(PB4); }
inline bool left_b(uint8_t port) { return port & _BV(PB5); }
inline bool right_a(uint8_t port) { return port & _BV(PB6); }
inline bool right_b(uint8_t port) { return port & _BV(PB7); }

// One step of a channel pair from `was_a, was_b`: forward when the channel that changed now differs
// from the other (A) or equals it (B). Where both changed an edge was missed, and its direction with
// it.
inline void step(Encoder &encoder, bool was_a, bool was_b, bool a, bool b) {
    const bool a_changed = a != was_a;
    if (a_changed == (b != was_b)) {
        ++encoder.illegal;
        return;
    }
    encoder.count(a_changed ? a != b : a == b);
}

} // namespace

ISR(PCINT0_vect) {
    const uint8_t was = levels;
    const uint8_t now = PINB;
    levels = now;
    const uint8_t changed = was ^ now;
    if (changed & (_BV(PB4) | _BV(PB5))) {
        step(left, left_a(was), left_b(was), left_a(now), left_b(now));
    }
    if (changed & (_BV(PB6) | _BV(PB7))) {
        step(right, right_a(was), right_b(was), right_a(now), right_b(now));
    }
    // All is as it was: a pulse too short to show whose it was.
    if (!(changed & CHANNELS) && !more_came) {
        ++left.illegal;
        ++right.illegal;
    }
    more_came = PCIFR & _BV(PCIF0);
}

static void enable_interrupts() {
    levels = PINB;
    PCMSK0 |= CHANNELS; // PCINT4 to 7 are PB4 to 7
    PCIFR = _BV(PCIF0);
    PCICR |= _BV(PCIE0);
}

#endif

void encoders::begin() {
    // The encoders' outputs may be open collectors, and a wire that came off must not float.
    pinMode(LEFT_ENCODER_A_PIN, INPUT_PULLUP);
    pinMode(LEFT_ENCODER_B_PIN, INPUT_PULLUP);
    pinMode(RIGHT_ENCODER_A_PIN, INPUT_PULLUP);
    pinMode(RIGHT_ENCODER_B_PIN, INPUT_PULLUP);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        enable_interrupts();
    }
}

Wheels<EdgeCounts> encoders::counts() {
    return {left.counts(), right.counts()};
}
