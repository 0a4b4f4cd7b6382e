#include "tick_counter.h"

namespace {

uint32_t moved(uint16_t now, uint16_t before, bool reversed) {
    const int32_t edges = static_cast<int16_t>(static_cast<uint16_t>(now - before));
    return static_cast<uint32_t>(reversed ? -edges : edges);
}

} // namespace

void TickCounter::reverse(uint8_t reversed) {
    reversed_encoders = reversed;
}

Wheels<int32_t> TickCounter::count(const Wheels<EdgeCounts> &edges) {
    const Wheels<uint16_t> now = {static_cast<uint16_t>(edges.left.forward - edges.left.backward),
                                  static_cast<uint16_t>(edges.right.forward - edges.right.backward)};
    ticks.left +=
        moved(now.left, last.left, reversed_encoders & SETTINGS_REVERSED_LEFT_ENCODER);
    ticks.right +=
        moved(now.right, last.right, reversed_encoders & SETTINGS_REVERSED_RIGHT_ENCODER);
    last = now;
    return {static_cast<int32_t>(ticks.left), static_cast<int32_t>(ticks.right)};
}
