// The firmware's pure parts behind C functions, for ctypes.
#include "displacement.h"
#include "framing.h"
#include "odometry.h"
#include "settings.h"
#include "speed_control.h"
#include "tick_counter.h"

extern "C" {

uint8_t frame_encode(const void *content, uint8_t size, uint8_t *encoded) {
    return framing::encode(content, size, encoded);
}

framing::Decoder *decoder_new() { return new framing::Decoder; }
void decoder_delete(framing::Decoder *decoder) { delete decoder; }
uint8_t decoder_feed(framing::Decoder *decoder, uint8_t byte) { return decoder->feed(byte); }
const uint8_t *decoder_content(const framing::Decoder *decoder) { return decoder->content(); }
uint16_t decoder_bad(const framing::Decoder *decoder) { return decoder->bad(); }

SpeedControl *control_new(const settings_frame *settings) {
    auto *control = new SpeedControl;
    control->configure(*settings);
    return control;
}
void control_delete(SpeedControl *control) { delete control; }
void control_want(SpeedControl *control, int16_t ticks_per_s) { control->aim(ticks_per_s); }
void control_stop(SpeedControl *control) { control->stop(); }
int16_t control_step(SpeedControl *control, int32_t position, int16_t full_duty) {
    return control->step(position, full_duty);
}

DisplacementReports *reports_new() { return new DisplacementReports; }
void reports_delete(DisplacementReports *reports) { delete reports; }
bool reports_due(DisplacementReports *reports, uint32_t now_us, uint8_t rate_hz) {
    return reports->due(now_us, rate_hz);
}
void reports_make(DisplacementReports *reports, uint32_t time_us, int32_t left, int32_t right,
                  displacement_frame *frame) {
    *frame = reports->make(time_us, {left, right});
}

odometry::Odometry *odometry_new() { return new odometry::Odometry; }
void odometry_delete(odometry::Odometry *odometry) { delete odometry; }
void odometry_configure(odometry::Odometry *odometry, const settings_frame *settings) {
    odometry->configure(*settings);
}
void odometry_advance(odometry::Odometry *odometry, int32_t left, int32_t right, int32_t *sums) {
    odometry->advance({left, right});
    sums[0] = odometry->distance();
    sums[1] = odometry->heading();
}

uint8_t settings_record_size() { return sizeof(settings::Record); }
void settings_defaults(settings_frame *fields) { *fields = settings::defaults(); }
void settings_bounded(settings_frame *fields) { *fields = settings::bounded(*fields); }
void settings_pack(const settings_frame *fields, settings::Record *record) {
    *record = settings::pack(*fields);
}
bool settings_unpack(const settings::Record *record, settings_frame *fields) {
    return settings::unpack(*record, fields);
}
}
