/* Rows in, rows out, for trying shock_correct on a computer:

     ./shock_csv < rows.csv > corrected.csv

   The first line names the columns, of which these are read: time_s, temperature_c, humidity_percent, airspeed_m_s,
   pressure_hpa, humidity_sensor_temperature_c. Without an input that has them it says so and ends with status 1. */
#include "shock_correct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LONGEST_LINE 4096
static const char *const NAMES[] = {"time_s",       "temperature_c", "humidity_percent",
                                    "airspeed_m_s", "pressure_hpa",  "humidity_sensor_temperature_c"};
enum { TIME, TEMPERATURE, HUMIDITY, AIRSPEED, PRESSURE, DIE, COLUMNS };

static void show(float value) {
  if (isfinite(value)) printf(",%.5f", (double)value);
  else printf(",");
}

int main(void) {
  static shock_state state;
  static char line[LONGEST_LINE];
  int place[COLUMNS], column, c;
  char *cell;
  for (c = 0; c < COLUMNS; c++) place[c] = -1;
  if (fgets(line, sizeof line, stdin) == NULL) line[0] = '\0';
  line[strcspn(line, "\r\n")] = '\0';
  for (column = 0, cell = line; cell != NULL; column++) {
    char *end = strchr(cell, ',');
    if (end != NULL) *end++ = '\0';
    for (c = 0; c < COLUMNS; c++)
      if (strcmp(cell, NAMES[c]) == 0) place[c] = column;
    cell = end;
  }
  if (place[TIME] < 0 || place[TEMPERATURE] < 0 || place[HUMIDITY] < 0) {
    fprintf(stderr, "expected a first line with the columns time_s, temperature_c and humidity_percent;\n"
                    "shockrig onboard --flight LOG writes rows.csv of any log\n");
    return 1;
  }
  shock_begin(&state);
  printf("time_s,temperature_corrected_c,temperature_uncertainty_k,humidity_corrected_percent,"
         "humidity_uncertainty_percent,temperature_flags,humidity_flags\n");
  while (fgets(line, sizeof line, stdin) != NULL) {
    double value[COLUMNS];
    shock_row row;
    shock_air air = {NAN, NAN, NAN, NAN, SHOCK_IMPLAUSIBLE, SHOCK_IMPLAUSIBLE};
    for (c = 0; c < COLUMNS; c++) value[c] = (double)NAN;
    for (column = 0, cell = line; cell != NULL; column++) {
      char *end = strchr(cell, ','), *stop;
      if (end != NULL) *end++ = '\0';
      for (c = 0; c < COLUMNS; c++)
        if (place[c] == column) {
          value[c] = strtod(cell, &stop);
          if (stop == cell) value[c] = (double)NAN;
        }
      cell = end;
    }
    if (fabs(value[TIME]) < 9e12) {
      row.time_us = (int64_t)floor(value[TIME] * 1e6 + 0.5);
      row.temperature_c = (float)value[TEMPERATURE];
      row.humidity_percent = (float)value[HUMIDITY];
      row.airspeed_m_s = (float)value[AIRSPEED];
      row.pressure_hpa = (float)value[PRESSURE];
      row.die_temperature_c = (float)value[DIE];
      shock_step(&state, &row, &air);
      printf("%.6f", value[TIME]);
    }
    show(air.temperature_c);
    show(air.temperature_uncertainty_k);
    show(air.humidity_percent);
    show(air.humidity_uncertainty_percent);
    printf(",%d,%d\n", air.temperature_flags, air.humidity_flags);
  }
  return 0;
}
