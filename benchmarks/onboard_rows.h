/* The rows that onboard_avr.c and onboard_arm.c feed: a slow ramp with steps of a log on it. */
#include <math.h>

#include "shock_correct.h"

#ifndef ROWS
#define ROWS 40
#endif

static shock_state state;

static shock_row row_of(int i) {
  shock_row row = {0, 0, 0, 5.0f, 1000.0f, 0};
  row.time_us = i * 100000ll;
  row.temperature_c = 20.0f + 0.01f * (float)i + (float)((i * 7) % 5) * 0.01f;
  row.humidity_percent = 50.0f - 0.05f * (float)i + (float)((i * 5) % 7) * 0.02f;
  row.die_temperature_c = NAN;
  return row;
}
