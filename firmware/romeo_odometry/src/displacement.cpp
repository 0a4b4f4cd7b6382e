#include "displacement.h"

bool DisplacementReports::due(uint32_t now_us, uint8_t report_rate_hz) {
    const uint32_t period_us = 1000000UL / report_rate_hz;
    const uint32_t since_us = now_us - last_due_us;
    if (since_us < period_us) {
        return false;
    }
    // On the beat, but for a delay of more than a whole period, which is not made up for.
    last_due_us = since_us < 2 * period_us ? last_due_us + period_us : now_us;
    return true;
}

void DisplacementReports::configure(const settings_frame &settings, Wheels<int32_t> ticks) {
    odometry.advance(ticks);
    odometry.configure(settings);
}

displacement_frame DisplacementReports::make(uint32_t time_us, Wheels<int32_t> ticks) {
    displacement_frame frame = {};
    frame.id = DISPLACEMENT_ID;
    frame.sequence = sequence++;
    frame.board_time_us = time_us;
    frame.left_ticks = ticks.left;
    frame.right_ticks = ticks.right;
    odometry.advance(ticks);
    frame.distance_um = odometry.distance();
    frame.heading_urad = odometry.heading();
    return frame;
}
