#include "settings.h"

#include "framing.h"

namespace {

constexpr uint8_t LAYOUT_VERSION = 2;

uint16_t crc_of(const settings::Record &record) {
    return framing::crc16(&record, sizeof record - sizeof record.crc);
}

template <typename T>
T between(T value, T least, T most) {
    return value < least ? least : value > most ? most : value;
}

} // namespace

settings_frame settings::defaults() {
    settings_frame fields = {};
    fields.id = SETTINGS_ID;
    fields.report_rate_hz = PROTOCOL_REPORT_RATE_HZ;
    fields.full_speed = PROTOCOL_FULL_SPEED_TICKS_PER_S;
    fields.proportional = PROTOCOL_PROPORTIONAL_16THS;
    fields.integral = PROTOCOL_INTEGRAL_16THS_PER_S;
    fields.acceleration = PROTOCOL_ACCELERATION_TICKS_PER_S2;
    fields.runaway = PROTOCOL_RUNAWAY_MS;
    fields.left_radius = fields.right_radius = PROTOCOL_RADIUS_NM;
    fields.track = PROTOCOL_TRACK_NM;
    fields.counts_per_turn = PROTOCOL_COUNTS_PER_TURN;
    return fields;
}

settings_frame settings::bounded(settings_frame wanted) {
    wanted.id = SETTINGS_ID;
    wanted.report_rate_hz = between<uint8_t>(wanted.report_rate_hz, PROTOCOL_REPORT_RATE_MIN_HZ,
                                             PROTOCOL_REPORT_RATE_MAX_HZ);
    wanted.reversed &= SETTINGS_REVERSED_ALL;
    wanted.full_speed =
        between<uint16_t>(wanted.full_speed, PROTOCOL_FULL_SPEED_MIN_TICKS_PER_S, UINT16_MAX);
    wanted.acceleration =
        between<uint16_t>(wanted.acceleration, PROTOCOL_ACCELERATION_MIN_TICKS_PER_S2, UINT16_MAX);
    wanted.left_radius = between<uint32_t>(wanted.left_radius, 0, PROTOCOL_RADIUS_MAX_NM);
    wanted.right_radius = between<uint32_t>(wanted.right_radius, 0, PROTOCOL_RADIUS_MAX_NM);
    wanted.track = between<uint32_t>(wanted.track, PROTOCOL_TRACK_MIN_NM, UINT32_MAX);
    wanted.counts_per_turn =
        between<uint32_t>(wanted.counts_per_turn, PROTOCOL_COUNTS_PER_TURN_MIN, UINT32_MAX);
    return wanted;
}

settings::Record settings::pack(const settings_frame &fields) {
    Record record = {LAYOUT_VERSION, fields, 0};
    record.crc = crc_of(record);
    return record;
}

bool settings::unpack(const Record &record, settings_frame *fields) {
    if (record.version != LAYOUT_VERSION || record.crc != crc_of(record)) {
        return false;
    }
    *fields = bounded(record.fields);
    return true;
}
