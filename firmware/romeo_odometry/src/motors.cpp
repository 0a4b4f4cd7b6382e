#include "motors.h"

#include <Arduino.h>

#include "protocol.h"
#include "wiring.h"

namespace {

volatile uint8_t reversed_motors;

void drive_one(uint8_t direction_pin, uint8_t pwm_pin, int16_t duty, bool reversed) {
    if (duty != 0) {
        digitalWrite(direction_pin, (duty > 0) != reversed ? HIGH : LOW);
    }
    analogWrite(pwm_pin, duty < 0 ? -duty : duty);
}

} // namespace

void motors::begin() {
    // Enable pins low first: a direction pin alone moves nothing.
    digitalWrite(LEFT_PWM_PIN, LOW);
    digitalWrite(RIGHT_PWM_PIN, LOW);
    pinMode(LEFT_PWM_PIN, OUTPUT);
    pinMode(RIGHT_PWM_PIN, OUTPUT);
    pinMode(LEFT_DIRECTION_PIN, OUTPUT);
    pinMode(RIGHT_DIRECTION_PIN, OUTPUT);
}

void motors::reverse(uint8_t reversed) {
    reversed_motors = reversed;
}

void motors::drive(Wheels<int16_t> duty) {
    const uint8_t reversed = reversed_motors;
    drive_one(LEFT_DIRECTION_PIN, LEFT_PWM_PIN, duty.left,
              reversed & SETTINGS_REVERSED_LEFT_MOTOR);
    drive_one(RIGHT_DIRECTION_PIN, RIGHT_PWM_PIN, duty.right,
              reversed & SETTINGS_REVERSED_RIGHT_MOTOR);
}
