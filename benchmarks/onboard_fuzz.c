/* Random rows through a generated program: a number wherever a value is given, and never a NaN for good.

   Prints how many rows were fed, how many values were given, and how many of them, or of their uncertainties, were no
   finite number; ends with status 1 where any was, or where a minute of good rows brings no value back. */
#include "shock_correct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t seed = 88172645463325252ull;

static uint32_t draw(void) {
  seed ^= seed << 13;
  seed ^= seed >> 7;
  seed ^= seed << 17;
  return (uint32_t)(seed >> 32);
}

static float uniform(float low, float high) { return low + (high - low) * (float)draw() / 4294967296.0f; }

static float any(float low, float high, float last) {
  uint32_t bits = draw();
  float value;
  switch (draw() % 24u) {
  case 0: return NAN;
  case 1: return (draw() & 1u) ? INFINITY : -INFINITY;
  case 2: memcpy(&value, &bits, sizeof value); return value; /* any bits */
  case 3: return 1e30f;
  case 4: return uniform(10.0f * low, 10.0f * high);
  case 5: case 6: return uniform(low, high);
  case 7: case 8: case 9: return last;
  case 10: return -99.0f;
  case 11: return 0.0f;
  default: return last + uniform(-0.3f, 0.3f);
  }
}

int main(int count, char **arguments) {
  static shock_state state;
  long rows = count > 1 ? atol(arguments[1]) : 100000, i, given = 0, wrong = 0, dead = 0, phases = 0;
  shock_row row = {0, 20.0f, 50.0f, 5.0f, 1000.0f, 20.0f};
  shock_begin(&state);
  for (i = 0; i < rows; i++) {
    shock_air air;
    int calm = (i / 2000) % 4 == 3; /* every fourth stretch is of good rows */
    if (calm) {
      row.time_us = (int64_t)((uint64_t)row.time_us + 100000u);
      row.temperature_c = 15.0f + uniform(-0.05f, 0.05f);
      row.humidity_percent = 60.0f + uniform(-0.2f, 0.2f);
      row.airspeed_m_s = 8.0f;
      row.pressure_hpa = 900.0f;
      row.die_temperature_c = 16.0f;
    } else {
      switch (draw() % 40u) {
      case 0: row.time_us = (int64_t)((uint64_t)row.time_us + draw() * 1000ull); break;
      case 1: row.time_us = (int64_t)((uint64_t)row.time_us - draw() / 100u); break;
      case 2: break;
      case 3: row.time_us = (int64_t)(((uint64_t)draw() << 32) | draw()); break;
      case 4: row.time_us = (int64_t)((uint64_t)row.time_us + 1u); break;
      default: row.time_us = (int64_t)((uint64_t)row.time_us + 100000u);
      }
      row.temperature_c = any(-60.0f, 60.0f, isfinite(row.temperature_c) ? row.temperature_c : 20.0f);
      row.humidity_percent = any(0.0f, 100.0f, isfinite(row.humidity_percent) ? row.humidity_percent : 50.0f);
      row.airspeed_m_s = any(0.0f, 30.0f, 5.0f);
      row.pressure_hpa = any(300.0f, 1050.0f, 900.0f);
      row.die_temperature_c = any(-40.0f, 60.0f, 20.0f);
    }
    shock_step(&state, &row, &air);
    if (calm && i % 2000 == 1999) {
      phases++;
      if (!isfinite(air.temperature_c) || !isfinite(air.humidity_percent)) dead++;
    }
    if (!isnan(air.temperature_c)) {
      given++;
      if (!isfinite(air.temperature_c) || !isfinite(air.temperature_uncertainty_k)) wrong++;
    }
    if (!isnan(air.humidity_percent)) {
      given++;
      if (!isfinite(air.humidity_percent) || !isfinite(air.humidity_uncertainty_percent)) wrong++;
    }
    if (isnan(state.bead.middle) || isnan(state.film.middle) || isnan(state.film_mean[0])) wrong++;
  }
  printf("%ld rows, %ld values given, %ld of them no number; after %ld stretches of good rows %ld without a value\n", rows,
         given, wrong, phases, dead);
  return wrong || dead;
}
