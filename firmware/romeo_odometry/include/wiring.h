// Which pin is what: the only place. docs/hardware.md draws it and gives the reasons.
#pragma once

#include <stdint.h>

// 2: both edges of channel A, on the external interrupts D2 and D3, which are I2C's pins too.
// 4: every edge of both channels, on the pin-change interrupt of D8 to D11. Twice the counts per
//    turn: set counts_per_turn in robot.toml.
#ifndef ENCODER_EDGES
#define ENCODER_EDGES 2
#endif

#if ENCODER_EDGES == 2
constexpr uint8_t LEFT_ENCODER_A_PIN = 2;
constexpr uint8_t RIGHT_ENCODER_A_PIN = 3;
#elif ENCODER_EDGES == 4
constexpr uint8_t LEFT_ENCODER_A_PIN = 8;
constexpr uint8_t RIGHT_ENCODER_A_PIN = 10;
#else
#error "ENCODER_EDGES is 2 or 4"
#endif
constexpr uint8_t LEFT_ENCODER_B_PIN = 9;
constexpr uint8_t RIGHT_ENCODER_B_PIN = 11;

constexpr uint8_t LEFT_DIRECTION_PIN = 4;  // M1
constexpr uint8_t LEFT_PWM_PIN = 5;        // E1
constexpr uint8_t RIGHT_PWM_PIN = 6;       // E2
constexpr uint8_t RIGHT_DIRECTION_PIN = 7; // M2
