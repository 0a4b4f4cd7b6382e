#include "encoders.h"

#include <Arduino.h>
#include <util/atomic.h>

#include "protocol.h"
#include "wiring.h"

namespace {

struct Encoder {
    // Unsigned, because they run over.
    volatile uint32_t edges; // counts up with channel A ahead of B
    uint32_t offset;         // keeps the ticks where they were when the sign changes
    bool reversed;

    uint32_t ticks() const { return reversed ? offset - edges : offset + edges; }

    void reverse(bool now_reversed) {
        const uint32_t before = ticks();
        reversed = now_reversed;
        offset = reversed ? before + edges : before - edges;
    }
};

Encoder left;
Encoder right;

// The levels are read from the ports themselves: digitalRead takes 3 us, time for the next edge.
static_assert(LEFT_ENCODER_B_PIN == 9 && RIGHT_ENCODER_B_PIN == 11, "are PB5 and PB7 below");

} // namespace

#if ENCODER_EDGES == 2

static_assert(LEFT_ENCODER_A_PIN == 2 && RIGHT_ENCODER_A_PIN == 3, "are PD1 and PD0, INT1 and INT0");

namespace {

inline bool left_a() { return PIND & _BV(PD1); }
inline bool left_b() { return PINB & _BV(PB5); }
inline bool right_a() { return PIND & _BV(PD0); }
inline bool right_b() { return PINB & _BV(PB7); }

} // namespace

// After an edge of A the channels differ when A is ahead, and are equal when B is.
ISR(INT1_vect) { left.edges += left_a() != left_b() ? 1 : -1; }
ISR(INT0_vect) { right.edges += right_a() != right_b() ? 1 : -1; }

static void enable_interrupts() {
    EICRA |= _BV(ISC00) | _BV(ISC10); // on any change
    EICRA &= ~(_BV(ISC01) | _BV(ISC11));
    EIFR = _BV(INTF0) | _BV(INTF1);
    EIMSK |= _BV(INT0) | _BV(INT1);
}

#else

static_assert(LEFT_ENCODER_A_PIN == 8 && RIGHT_ENCODER_A_PIN == 10, "are PB4 and PB6, PCINT4 and 6");

namespace {

volatile uint8_t levels;

inline bool left_a(uint8_t port) { return port & _BV(PB4); }
inline bool left_b(uint8_t port) { return port & _BV(PB5); }
inline bool right_a(uint8_t port) { return port & _BV(PB6); }
inline bool right_b(uint8_t port) { return port & _BV(PB7); }

// One step of a channel pair from `a, b`: forward when the channel that changed now differs from
// the other (A) or equals it (B). Where both changed an edge was missed, and its direction with it.
inline int8_t step(bool was_a, bool was_b, bool a, bool b) {
    const bool a_changed = a != was_a;
    if (a_changed == (b != was_b)) {
        return 0;
    }
    return (a_changed ? a != b : a == b) ? 1 : -1;
}

} // namespace

ISR(PCINT0_vect) {
    const uint8_t was = levels;
    const uint8_t now = PINB;
    levels = now;
    const uint8_t changed = was ^ now;
    if (changed & (_BV(PB4) | _BV(PB5))) {
        left.edges += step(left_a(was), left_b(was), left_a(now), left_b(now));
    }
    if (changed & (_BV(PB6) | _BV(PB7))) {
        right.edges += step(right_a(was), right_b(was), right_a(now), right_b(now));
    }
}

static void enable_interrupts() {
    levels = PINB;
    PCMSK0 |= _BV(PCINT4) | _BV(PCINT5) | _BV(PCINT6) | _BV(PCINT7);
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

void encoders::reverse(uint8_t reversed) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        left.reverse(reversed & SETTINGS_REVERSED_LEFT_ENCODER);
        right.reverse(reversed & SETTINGS_REVERSED_RIGHT_ENCODER);
    }
}

Wheels<int32_t> encoders::read() {
    return {static_cast<int32_t>(left.ticks()), static_cast<int32_t>(right.ticks())};
}
