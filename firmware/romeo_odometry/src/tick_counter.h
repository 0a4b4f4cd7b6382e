// From the encoders' edges to ticks that go forward and do not run over with them. Pure.
#pragma once

#include <stdint.h>

#include "protocol.h"
#include "wheels.h"

// What an encoder's interrupts have seen since start, modulo 2^16 each.
struct EdgeCounts {
    uint16_t forward; // with channel A ahead of B
    uint16_t backward;
    uint16_t illegal; // too near to each other for a wheel: noise, or edges that were missed

    EdgeCounts since(const EdgeCounts &before) const {
        return {static_cast<uint16_t>(forward - before.forward),
                static_cast<uint16_t>(backward - before.backward),
                static_cast<uint16_t>(illegal - before.illegal)};
    }
};

class TickCounter {
public:
    // SETTINGS_REVERSED_ bits: which encoders count down when driving forward. The ticks so far stay.
    void reverse(uint8_t reversed);

    // Ticks since start, forward positive, modulo 2^32, where the edges stand so. To be asked before 2^15
    // more have come.
    Wheels<int32_t> count(const Wheels<EdgeCounts> &edges);

private:
    Wheels<uint16_t> last = {0, 0};
    Wheels<uint32_t> ticks = {0, 0}; // unsigned, because they run over and that is no error
    uint8_t reversed_encoders = 0;
};
