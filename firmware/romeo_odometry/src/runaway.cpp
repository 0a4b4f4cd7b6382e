#include "runaway.h"

#include "speed_control.h"

namespace {

constexpr uint8_t HARD_SHARE = 3;     // of full duty: more than a wheel on the ground needs to start
constexpr uint8_t PROGRESS_SHARE = 4; // of the speed asked for
constexpr uint8_t LEAST_PROGRESS = 2; // ticks: an edge that trembles is none

constexpr uint8_t SPARE_EDGES = 8; // of a period, beyond half as many again as at full speed
constexpr uint8_t MOST_ILLEGAL = 40; // in a period: a motor's PWM may cause a dozen
constexpr uint8_t MOST_AGAINST = 6;  // in a period: a wheel that trembles makes fewer

uint16_t sum(uint16_t value, uint8_t more) {
    return value > UINT16_MAX - more ? UINT16_MAX : value + more;
}

// Is `progress` (ticks) what a share of the speed makes in so many periods?
bool is_enough(int32_t progress, int16_t asked, uint16_t periods) {
    constexpr int16_t SCALE = PROGRESS_SHARE * CONTROL_HZ;
    const int32_t speed = asked < 0 ? -static_cast<int32_t>(asked) : asked;
    return progress > INT32_MAX / SCALE || progress * SCALE >= speed * periods;
}

} // namespace

void RunawayDetector::configure(const settings_frame &settings) {
    limit = settings.runaway / (1000 / CONTROL_HZ);
    if (settings.runaway && !limit) {
        limit = 1;
    }
    most_edges = settings.full_speed / CONTROL_HZ * 3 / 2 + SPARE_EDGES;
}

bool RunawayDetector::step(uint8_t periods, int32_t position, int16_t asked, int16_t duty,
                           int16_t full_duty) {
    const bool now_forward = duty > 0;
    if (now_forward != forward) {
        begun = false;
    }
    if (!elapsed || now_forward != forward) {
        elapsed = 0;
        forward = now_forward;
        mark = position;
    }
    if ((now_forward ? duty : -duty) < full_duty / HARD_SHARE) {
        elapsed = elapsed > periods ? elapsed - periods : 0;
        return false;
    }
    const int32_t moved =
        static_cast<int32_t>(static_cast<uint32_t>(position) - static_cast<uint32_t>(mark));
    const int32_t progress = forward ? moved : -moved;
    // Of a time that is not so short that noise would pass for progress.
    const uint16_t least = limit / 8;
    elapsed = sum(elapsed, periods);
    if (progress < 0) {
        mark = position; // it runs out the old way; the time goes on
    } else if (progress >= LEAST_PROGRESS &&
               (!begun || is_enough(progress, asked, elapsed > least ? elapsed : least))) {
        elapsed = 0;
        begun = true;
    }
    return limit && elapsed >= limit;
}

bool RunawayDetector::listen(uint8_t periods, const EdgeCounts &edges) {
    const uint16_t with = edges.forward > edges.backward ? edges.forward : edges.backward;
    const uint16_t against = edges.forward + edges.backward - with;
    const uint32_t all = static_cast<uint32_t>(with) + against + edges.illegal;
    if (all > static_cast<uint32_t>(most_edges) * periods || edges.illegal > MOST_ILLEGAL * periods ||
        (against > MOST_AGAINST * periods && against > with / 3)) {
        noisy = sum(noisy, periods);
    } else {
        noisy = noisy > periods ? noisy - periods : 0;
    }
    return limit && noisy >= limit;
}
