// A Romeo V2 board in a robot: counts wheel ticks, holds wheel speeds, talks frames over USB.
//
// What must never wait runs in interrupts: the encoders' edges, and a hundred times a second the
// wheels' control with the command timeout. The loop does the rest and waits for nothing.

#include <Arduino.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "displacement.h"
#include "encoders.h"
#include "link.h"
#include "motors.h"
#include "protocol.h"
#include "settings_store.h"
#include "tick_counter.h"
#include "usb_control.h"
#include "version.h"
#include "wheel_control.h"
#include "wiring.h"

namespace {

DisplacementReports reports;
TickCounter ticks;
bool greeted;          // a host has said hello since start
bool settings_changed; // to be used, and answered, in the next pass: each takes a millisecond

void apply_settings() {
    const settings_frame &settings = settings_store::in_force();
    Wheels<EdgeCounts> edges;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        edges = encoders::counts();
    }
    reports.configure(settings, ticks.count(edges));
    ticks.reverse(settings.reversed);
    motors::reverse(settings.reversed);
    wheel_control::configure(settings);
}

void send_identity() {
    identity_frame frame = {};
    frame.id = IDENTITY_ID;
    frame.protocol_hash = PROTOCOL_HASH;
    frame.version_major = FIRMWARE_VERSION_MAJOR;
    frame.version_minor = FIRMWARE_VERSION_MINOR;
    frame.version_patch = FIRMWARE_VERSION_PATCH;
    frame.board = PROTOCOL_BOARD_ROMEO_V2;
    frame.edges_per_period = ENCODER_EDGES;
    link::send(&frame, sizeof frame);
}

void send_settings() {
    link::send(&settings_store::in_force(), sizeof(settings_frame));
}

uint8_t status() {
    const Wheels<bool> ran_away = wheel_control::ran_away();
    return (greeted ? 0 : DISPLACEMENT_STATUS_FRESH) |
           (wheel_control::timed_out() ? DISPLACEMENT_STATUS_COMMAND_TIMED_OUT : 0) |
           (settings_store::defaulted() ? DISPLACEMENT_STATUS_SETTINGS_DEFAULTED : 0) |
           (ran_away.left ? DISPLACEMENT_STATUS_LEFT_RUNAWAY : 0) |
           (ran_away.right ? DISPLACEMENT_STATUS_RIGHT_RUNAWAY : 0);
}

void send_displacement() {
    uint32_t now_us;
    Wheels<EdgeCounts> edges;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        now_us = micros();
        edges = encoders::counts();
    }
    // Also where nobody listens: before the edges run over.
    const Wheels<int32_t> counted = ticks.count(edges);
    if (!link::is_open()) {
        return;
    }
    displacement_frame frame = reports.make(now_us, counted);
    frame.left_illegal = edges.left.illegal;
    frame.right_illegal = edges.right.illegal;
    frame.status = status();
    frame.dropped_frames = link::dropped_frames();
    frame.bad_frames = link::bad_frames();
    link::send(&frame, sizeof frame);
}

// The content as a frame of this type, nullptr where it has another id or length.
template <typename T>
const T *as(uint8_t id, const uint8_t *content, uint8_t size) {
    return content[0] == id && size == sizeof(T) ? reinterpret_cast<const T *>(content) : nullptr;
}

void handle(const uint8_t *content, uint8_t size) {
    if (const auto *velocity = as<velocity_frame>(VELOCITY_ID, content, size)) {
        wheel_control::command({velocity->left_ticks_per_s, velocity->right_ticks_per_s});
    } else if (as<hello_frame>(HELLO_ID, content, size)) {
        greeted = true;
        send_identity();
    } else if (as<read_settings_frame>(READ_SETTINGS_ID, content, size)) {
        send_settings();
    } else if (const auto *settings = as<settings_frame>(SETTINGS_ID, content, size)) {
        // What runs the other way round from now on must not be driven meanwhile.
        if (settings->reversed != settings_store::in_force().reversed) {
            wheel_control::stop();
        }
        settings_store::write(*settings);
        settings_changed = true;
    } else {
        link::refuse();
    }
}

// Where edges without end leave the control no time, it is the watchdog that stops the motors. It is
// also the way into the bootloader: then it must not be held off.
void feed_watchdog() {
    if (wheel_control::has_run() && !link::bootloader_asked()) {
        // Set anew each time, because the core shortens it while the host asks for the bootloader.
        wdt_enable(WDTO_500MS);
    }
}

} // namespace

// The bootloader stops the watchdog that a reset leaves running; a board without one must too.
void stop_watchdog() __attribute__((naked, used, section(".init3")));
void stop_watchdog() {
    MCUSR = 0;
    wdt_disable();
}

void setup() {
    motors::begin();
    encoders::begin();
    wheel_control::begin();
    settings_store::begin();
    apply_settings();
    link::begin();
    wdt_enable(WDTO_500MS);
}

// Not inlined, so that the simulator can time its passes.
void __attribute__((noinline)) loop() {
    usb_control::step();
    feed_watchdog();
    uint8_t size;
    if (settings_changed) {
        settings_changed = false;
        apply_settings();
        send_settings();
    } else if (const uint8_t *content = link::receive(&size)) {
        handle(content, size);
    }
    settings_store::step();
    if (reports.due(micros(), settings_store::in_force().report_rate_hz)) {
        send_displacement();
    }
}
