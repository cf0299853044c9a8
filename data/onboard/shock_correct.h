/* Temperature and humidity of the air from a thermometer and a hygrometer that lag, row by row, with uncertainties.

   Written by `shockrig onboard` from @PROFILE@ (@NOTE@).
   C99, single precision, no allocation; of libraries math.h alone. What it can and cannot do stands in README.md. */
#ifndef SHOCK_CORRECT_H
#define SHOCK_CORRECT_H

#include <stdint.h>

/* Filters of each channel, and their states: air, lags, and (of humidity) what passes air and sensor alike. */
#define SHOCK_FILTERS 4
#define SHOCK_STRENGTHS @WEIGHED@ /* of the air's turbulence, of which each has a probability */
#define SHOCK_BEAD_STATES @BEAD_STATES@
#define SHOCK_FILM_STATES @FILM_STATES@
#define SHOCK_STATE_BYTES @STATE_BYTES@ /* at most: without padding as most compilers lay it out */

/* What is said of a reading. */
enum {
  SHOCK_MISSING = 1,     /* no reading */
  SHOCK_REPEATED = 2,    /* the reading before, or a sensor that is stuck */
  SHOCK_IMPLAUSIBLE = 4, /* no air made it: a code, a jump that the lag does not let through, a row out of time */
  SHOCK_OUTSIDE = 8,     /* the air is outside of what the profile speaks for */
  SHOCK_AS_READ = 16     /* the value is the reading itself */
};

/* One row; a value that is missing is NAN. Times run in microseconds from any start. */
typedef struct {
  int64_t time_us;
  float temperature_c;
  float humidity_percent;
  float airspeed_m_s;
  float pressure_hpa;
  float die_temperature_c;
} shock_row;

/* The air of that row and standard uncertainties; NAN where nothing can be given. */
typedef struct {
  float temperature_c;
  float temperature_uncertainty_k;
  float humidity_percent;
  float humidity_uncertainty_percent;
  uint8_t temperature_flags;
  uint8_t humidity_flags;
} shock_air;

typedef struct {
  float last, before, third;
  float step, smallest, smallest_before;
  float often, width, anchor;
  float burst[2], usual[2];
  uint16_t changes, stays, equal, unused;
  uint8_t refused, decimals;
} shock_guard;

typedef struct {
  float middle, usual;
  float likely[SHOCK_FILTERS], chance[SHOCK_STRENGTHS];
  float since_used_s, since_read_s, shown;
  shock_guard guard;
  uint8_t started;
} shock_channel;

typedef struct {
  int64_t time_us, stray_us;
  float airspeed_m_s, pressure_hpa, reading_c;
  float last_c, before_c;
  uint8_t strays, begun, strayed;
  shock_channel bead, film;
  float bead_mean[SHOCK_FILTERS * SHOCK_BEAD_STATES];
  float bead_p[SHOCK_FILTERS * SHOCK_BEAD_STATES * (SHOCK_BEAD_STATES + 1) / 2];
  float film_mean[SHOCK_FILTERS * SHOCK_FILM_STATES];
  float film_p[SHOCK_FILTERS * SHOCK_FILM_STATES * (SHOCK_FILM_STATES + 1) / 2];
} shock_state;

/* Before the first row. */
void shock_begin(shock_state *state);

/* Take a row in, and give the air of that row. */
void shock_step(shock_state *state, const shock_row *row, shock_air *air);

#endif
