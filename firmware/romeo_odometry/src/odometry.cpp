#include "odometry.h"

namespace {

// A tick is 2 pi radius / counts_per_turn of way. Half of it is distance, the track-th part heading:
//   distance [2^-32 um] = pi 2^32 / 1000 * radius [nm] / counts
//   heading [2^-32 urad] = distance * 2 * 10^9 / track [nm]
// Both by products with 64 bits of pi / counts and of 1 / track: a division takes 0.2 ms here.
constexpr uint64_t PI_2_72_THOUSANDTH = 14835751850141947581ULL;
constexpr uint32_t TWO_METRES = 2000000000; // nm

uint32_t low(uint64_t value) { return static_cast<uint32_t>(value); }
uint32_t high(uint64_t value) { return static_cast<uint32_t>(value >> 32); }

uint64_t product(uint32_t left, uint32_t right) { return static_cast<uint64_t>(left) * right; }

// The upper 64 bits of a product of 128. Not inlined, as advance() is not: arithmetic of 64 bits is
// long code on this chip.
uint64_t __attribute__((noinline)) upper_product(uint64_t left, uint64_t right) {
    const uint64_t middle = product(high(left), low(right)) + high(product(low(left), low(right)));
    const uint64_t other = product(low(left), high(right)) + low(middle);
    return product(high(left), high(right)) + high(middle) + high(other);
}

// TWO_METRES * 2^55 / divisor, in two steps of long division.
uint64_t track_reciprocal(uint32_t track) {
    const uint64_t dividend = static_cast<uint64_t>(TWO_METRES) << 33;
    const uint64_t quotient = dividend / track;
    const uint32_t remainder = static_cast<uint32_t>(dividend - quotient * track);
    return (quotient << 22) + (static_cast<uint64_t>(remainder) << 22) / track;
}

// How far a counter has gone, with its sign in all 64 bits.
uint64_t moved(int32_t now, int32_t before) {
    const uint32_t difference = static_cast<uint32_t>(now) - static_cast<uint32_t>(before);
    return static_cast<uint64_t>(static_cast<int64_t>(static_cast<int32_t>(difference)));
}

} // namespace

void odometry::Odometry::configure(const settings_frame &settings) {
    const uint64_t pi_a_count = PI_2_72_THOUSANDTH / settings.counts_per_turn;
    const uint64_t reciprocal = track_reciprocal(settings.track);
    const auto set = [&](uint32_t radius, uint64_t &distance, uint64_t &heading) {
        const uint64_t fine = upper_product(pi_a_count, static_cast<uint64_t>(radius) << 34);
        distance = (fine + (1 << 9)) >> 10;
        heading = (upper_product(fine, reciprocal) + 1) >> 1;
    };
    set(settings.left_radius, distance_a_tick.left, heading_a_tick.left);
    set(settings.right_radius, distance_a_tick.right, heading_a_tick.right);
}

void odometry::Odometry::advance(Wheels<int32_t> ticks) {
    const Wheels<uint64_t> by = {moved(ticks.left, last.left), moved(ticks.right, last.right)};
    last = ticks;
    distance_sum += distance_a_tick.left * by.left + distance_a_tick.right * by.right;
    heading_sum += heading_a_tick.right * by.right - heading_a_tick.left * by.left;
}
