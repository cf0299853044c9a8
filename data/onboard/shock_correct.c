/* Written by `shockrig onboard`; see shock_correct.h. The recursion is that of `shockrig correct --method causal`. */
#include "shock_correct.h"

#include <math.h>
#include <stddef.h>

typedef struct {
  uint8_t nodes[3]; /* of temperature, ln airspeed, ln pressure */
  uint8_t columns;
  const float *axis[3];
  const float *values;
} table;

typedef struct {
  uint8_t modes, slow, passing, size, codes;
  table response, readout; /* weights, ln rates, relative uncertainty; offset, gain, uncertainty */
  const float *slow_uncertainty, *code, *ln_resolved;
  /* strengths over the usual one, their logarithms, and how likely each is before anything is read */
  const float *strength, *ln_strength, *before;
  float noise, share, low, high, swing, ceiling, left, delay_s;
  float lowest, highest, door, low_c, high_c, straight_s, unsure_of_airspeed, spread;
} design;

/*@TABLES@*/

typedef char shock_state_is_small[(sizeof(shock_state) <= 2048) ? 1 : -1];

#define FAR_C @FAR_C@ /* beyond the table, where humidity is the reading, vapour is reckoned so far */
#define WALK 2
#define TURBULENT 3
#define AIR (WALK + TURBULENT)
#define MOST_STATES ((SHOCK_BEAD_STATES > SHOCK_FILM_STATES) ? SHOCK_BEAD_STATES : SHOCK_FILM_STATES)
#define MOST_COLUMNS (2 * MOST_STATES + 1)
#define PACKED(i, j) ((size_t)(i) * ((size_t)(i) + 1u) / 2u + (size_t)(j)) /* of j <= i */

static const float RATE[TURBULENT] = {@RATES@};
static const float VARIANCE[TURBULENT] = {@OU_VARIANCES@};

/* The filters: weak and strong turbulence on a trend that hardly bends, a trend that bends, and a door. */
enum { WEAK, STRONG, BENDING, DOOR };
static const float STRENGTH[DOOR] = {@TURBULENCE@};            /* times the middle one */
static const float BEND[SHOCK_FILTERS] = {@BENDS@}; /* of the trend over the turbulence, of the last two a door's */

/* One channel's filters, wherever they stand in the state. */
typedef struct {
  const design *d;
  shock_channel *own;
  float *mean, *p;
  float unit; /* what strengths, and the spread at a start, are in units of the states */
} bank;

typedef struct {
  float step_s, gone[TURBULENT], old[MOST_STATES], new_[MOST_STATES], decay[MOST_STATES];
  float swing[4];
} move;

typedef struct {
  float value, variance, stated; /* stated: of the normal distribution whose interval is as wide as the filters' */
} estimate;

/* What is known of a channel's air besides its readings: what passes sensor and air alike, and how fast that is; what
   goes through readings as noise would; how strong such air usually is (below 0: not known). */
typedef struct {
  float passing, speed, alike, usual;
} course;

typedef struct {
  uint8_t usable, missing, repeated, implausible, restart;
  float variance;
} verdict;

static float least(float a, float b) { return a < b ? a : b; }
static float most(float a, float b) { return a > b ? a : b; }
static float within(float x, float low, float high) { return most(least(x, high), low); }
static float length(float a, float b) { return sqrtf(a * a + b * b); }
static int holds(float x, float low, float high) { return x >= low && x <= high; }

static float saturation(float temperature_c) {
  float t = 1.0f - 373.15f / (temperature_c + 273.15f);
  return 1013.25f * expf(t * (13.3185f + t * (-1.9760f + t * (-0.6445f - 0.1299f * t))));
}

static float steepness(float temperature_c) {
  return logf(saturation(temperature_c + 0.5f) / saturation(temperature_c - 0.5f));
}

/* Values between the nodes of a table; beyond them those at its edge. */
static void look_up(const table *from, float temperature_c, float airspeed, float pressure, float *out) {
  const float wanted[3] = {temperature_c, logf(most(airspeed, @LEAST_AIRSPEED@)), logf(pressure)};
  uint8_t left[3], a, corner, c;
  float place[3];
  for (a = 0; a < 3; a++) {
    const float *axis = from->axis[a];
    uint8_t i = 0;
    place[a] = 0.0f;
    if (from->nodes[a] > 1) {
      while (i + 2 < from->nodes[a] && wanted[a] >= axis[i + 1]) i++;
      place[a] = within((wanted[a] - axis[i]) / (axis[i + 1] - axis[i]), 0.0f, 1.0f);
    }
    left[a] = i;
  }
  for (c = 0; c < from->columns; c++) out[c] = 0.0f;
  for (corner = 0; corner < 8; corner++) {
    float share = 1.0f;
    size_t at = 0;
    int there = 1;
    for (a = 0; a < 3; a++) {
      uint8_t upper = (uint8_t)((corner >> a) & 1u);
      if (upper && from->nodes[a] == 1) there = 0;
      share *= upper ? place[a] : 1.0f - place[a];
      at = at * from->nodes[a] + left[a] + upper;
    }
    if (!there || share == 0.0f) continue;
    for (c = 0; c < from->columns; c++) out[c] += share * from->values[at * from->columns + c];
  }
}

/* What a lag takes on in a step of air that is straight: 1 - exp(-x), and of it the part of the air after the step. */
static void hold(float x, float *gone, float *after) {
  if (x < 0.1f) {
    *gone = x * (1.0f - x / 2.0f * (1.0f - x / 3.0f * (1.0f - x / 4.0f * (1.0f - x / 5.0f))));
    *after = x / 2.0f * (1.0f - x / 3.0f * (1.0f - x / 4.0f * (1.0f - x / 5.0f)));
  } else {
    *gone = 1.0f - expf(-x);
    *after = 1.0f - *gone / x;
  }
}

static void strengths(const bank *b, float *square) {
  uint8_t f;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float own = f == DOOR ? b->d->door * b->unit : b->own->middle * STRENGTH[f];
    square[f] = own * own;
  }
}

static float possible(const bank *b, float strength) {
  return within(strength, b->d->lowest * b->unit, b->d->highest * b->unit);
}

/* Squares of the bends of the filters' trends. */
static void bends(const bank *b, float *square) {
  uint8_t f;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float own = BEND[f] * (f < BENDING ? b->own->middle * STRENGTH[f] : b->d->door * b->unit);
    square[f] = own * own;
  }
}

static float mean_strength(const bank *b, const float *strength) {
  float mean = 0.0f;
  uint8_t k;
  for (k = 0; k < SHOCK_STRENGTHS; k++) mean += b->own->chance[k] * strength[k];
  return mean;
}

/* The middle strength, by the probabilities of all that are weighed. */
static void settle(bank *b) {
  b->own->middle = possible(b, b->own->usual * expf(mean_strength(b, b->d->ln_strength)));
}

/* Mean of the strength over the middle one: as many times is the air's variance. */
static float unsure(const bank *b) {
  return mean_strength(b, b->d->strength) / expf(mean_strength(b, b->d->ln_strength));
}

/* How likely a reading is at each strength: `off` what the filters expected, whose variances without its noise are
   `own`; between the first two straight lines over ln of the strength. */
static void weigh(bank *b, const float *off, const float *own, float noise_variance) {
  float apart = logf(STRENGTH[STRONG] / STRENGTH[WEAK]), shift = logf(b->own->middle / b->own->usual), low = INFINITY;
  float weak = most(own[WEAK], @LEAST_VARIANCE@), strong = most(own[STRONG], @LEAST_VARIANCE@), sum = 0.0f;
  float power = within(logf(strong / weak) / apart, 0.0f, 2.0f), between = sqrtf(weak) * sqrtf(strong);
  float cost[SHOCK_STRENGTHS], variance[SHOCK_STRENGTHS];
  uint8_t k;
  for (k = 0; k < SHOCK_STRENGTHS; k++) {
    float over = b->d->ln_strength[k] - shift;
    float away = off[WEAK] + within(0.5f + over / apart, 0.0f, 1.0f) * (off[STRONG] - off[WEAK]);
    variance[k] = noise_variance + between * expf(power * over);
    cost[k] = 0.5f * away * away / variance[k];
    low = least(low, cost[k]);
  }
  for (k = 0; k < SHOCK_STRENGTHS; k++) {
    b->own->chance[k] *= expf(most(low - cost[k], -@MOST_UNLIKELY@)) / sqrtf(variance[k]);
    sum += b->own->chance[k];
  }
  for (k = 0; k < SHOCK_STRENGTHS; k++) b->own->chance[k] /= sum;
  settle(b);
}

/* The air's turbulence from row to row, as the standard deviation of noise that would change as much. */
static float wobble(const bank *b, float step_s) {
  float gone, after, sum = 0.0f;
  uint8_t i;
  for (i = 0; i < TURBULENT; i++) {
    hold(RATE[i] * step_s, &gone, &after);
    sum += VARIANCE[i] * gone;
  }
  return b->own->middle * sqrtf(sum);
}

/* A step of the states: y = phi x. */
static void carried(const bank *b, const move *m, const float *x, float *y) {
  uint8_t i, n = b->d->size, modes = b->d->modes;
  float before = x[0], after;
  y[0] = x[0] + m->step_s * x[1];
  y[1] = x[1];
  after = y[0];
  for (i = 0; i < TURBULENT; i++) {
    before += x[WALK + i];
    y[WALK + i] = m->gone[i] * x[WALK + i];
    after += y[WALK + i];
  }
  for (i = 0; i < modes; i++) y[AIR + i] = m->decay[i] * x[AIR + i] + m->old[i] * before + m->new_[i] * after;
  if (b->d->passing) {
    y[n - 2] = m->swing[0] * x[n - 2] + m->swing[1] * x[n - 1];
    y[n - 1] = m->swing[2] * x[n - 2] + m->swing[3] * x[n - 1];
  }
}

static float element(const float *p, uint8_t i, uint8_t j) { return i >= j ? p[PACKED(i, j)] : p[PACKED(j, i)]; }

/* P times a vector that is `air` on the air's states, `weight` on the lags, and 1 on what passes. */
static float spread(const bank *b, const float *p, const float *on, float *out) {
  uint8_t i, j, n = b->d->size;
  float total = 0.0f;
  for (i = 0; i < n; i++) {
    float sum = 0.0f;
    for (j = 0; j < n; j++)
      if (on[j] != 0.0f) sum += element(p, i, j) * on[j];
    if (out != NULL) out[i] = sum;
    total += on[i] * sum;
  }
  return total;
}

static float dot(const float *a, const float *b, uint8_t n) {
  float sum = 0.0f;
  uint8_t i;
  for (i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

/* Of the air, `slope` ahead and with `gone` of its turbulence. */
static void of_air(const bank *b, float slope, const float *gone, float *on) {
  uint8_t i, n = b->d->size;
  for (i = 0; i < n; i++) on[i] = 0.0f;
  on[0] = 1.0f;
  on[1] = slope;
  for (i = 0; i < TURBULENT; i++) on[WALK + i] = gone[i];
  if (b->d->passing) on[n - 1] = 1.0f;
}

static void of_reading(const bank *b, const float *weight, float *on) {
  uint8_t i, n = b->d->size;
  for (i = 0; i < n; i++) on[i] = 0.0f;
  for (i = 0; i < b->d->modes; i++) on[AIR + i] = weight[i];
  if (b->d->passing) on[n - 1] = 1.0f;
}

static size_t packed_size(const bank *b) { return PACKED(b->d->size, 0); }

/* Mean and variance over the filters, what their states say in the direction `on`; `added` variance to each. Of each
   filter how far its mean is `off` that of all, and its own variance. */
static estimate together(const bank *b, const float *on, const float *added, float *off, float *variance) {
  estimate found = {0.0f, 0.0f, 0.0f};
  float times = unsure(b);
  uint8_t f, n = b->d->size;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    off[f] = dot(on, b->mean + (size_t)f * n, n);
    found.value += b->own->likely[f] * off[f];
  }
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float own = most(spread(b, b->p + f * packed_size(b), on, NULL), 0.0f) + (added == NULL ? 0.0f : added[f]);
    variance[f] = times * own;
    off[f] -= found.value;
    found.variance += b->own->likely[f] * (variance[f] + off[f] * off[f]);
  }
  return found;
}

static float within_ends(float x) { return least(most(x, -@ERF_ENDS@), @ERF_ENDS@); }

static float erf_of(float x) { return tanhf(x * (@ERF@ + @ERF_BEND@ * x * x)); }

/* Half width of the interval in which @CONFIDENCE@ of a mixture of normal distributions lies: Newton's steps, and halves
   where they leave what is known of it. */
static float half_width(const bank *b, const float *off, const float *variance) {
  float deviation[SHOCK_FILTERS], low = 0.0f, high = 0.0f, sharp = 0.0f, width;
  uint8_t f, k;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    deviation[f] = sqrtf(2.0f * most(variance[f], @LEAST_VARIANCE@));
    high = most(high, fabsf(off[f]) + 2.0f * deviation[f]);
    sharp += 2.0f * b->own->likely[f] / (deviation[f] * deviation[f]);
  }
  width = least(@NORMAL_WIDTH@ / sqrtf(sharp), high);
  for (k = 0; k < @WIDTH_STEPS@; k++) {
    float inside = 0.0f, slope = 0.0f, last = width;
    for (f = 0; f < 2 * SHOCK_FILTERS; f++) {
      float s = deviation[f / 2], p = 0.5f * b->own->likely[f / 2];
      float x = within_ends((f % 2 ? width + off[f / 2] : width - off[f / 2]) / s), e = erf_of(x);
      inside += p * e;
      slope += p * (1.0f - e * e) * (@ERF@ + 3.0f * @ERF_BEND@ * x * x) / s;
    }
    if (inside < @CONFIDENCE@) low = width;
    else high = width;
    width += (@CONFIDENCE@ - inside) / most(slope, 1e-12f);
    if (!(width >= low && width <= high)) width = 0.5f * (low + high);
    if (fabsf(width - last) <= @WIDTH_SETTLED@ * width) break;
  }
  return width;
}

/* The air so long after what the last reading is of; how uncertain it is said to be is reckoned where it is `asked`. */
static estimate air_ahead(const bank *b, float ahead, int asked) {
  float on[MOST_STATES], gone[TURBULENT], added[SHOCK_FILTERS], extra = @UNSEEN@, cube = 0.0f;
  float off[SHOCK_FILTERS], variance[SHOCK_FILTERS], bend[SHOCK_FILTERS];
  estimate found;
  uint8_t i;
  for (i = 0; i < TURBULENT; i++) gone[i] = 1.0f;
  if (ahead > 0.0f) {
    cube = ahead * ahead * ahead / 3.0f;
    for (i = 0; i < TURBULENT; i++) {
      gone[i] = expf(-RATE[i] * ahead);
      extra += VARIANCE[i] * (1.0f - gone[i] * gone[i]);
    }
  }
  strengths(b, added);
  bends(b, bend);
  for (i = 0; i < SHOCK_FILTERS; i++) added[i] = added[i] * extra + bend[i] * cube;
  of_air(b, most(ahead, 0.0f), gone, on);
  found = together(b, on, added, off, variance);
  if (asked) {
    found.stated = half_width(b, off, variance) / @NORMAL_WIDTH@;
    found.stated *= found.stated;
  }
  return found;
}

static void start(bank *b, float level, const course *c) {
  uint8_t f, i, n = b->d->size;
  float square[SHOCK_FILTERS], wide = b->d->spread * b->unit * (b->d->spread * b->unit);
  b->own->usual = c->usual >= 0.0f ? possible(b, c->usual) : sqrtf(b->d->lowest * b->d->highest) * b->unit;
  for (i = 0; i < SHOCK_STRENGTHS; i++) b->own->chance[i] = b->d->before[i];
  settle(b);
  strengths(b, square);
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float *mean = b->mean + (size_t)f * n, *p = b->p + f * packed_size(b);
    size_t k;
    b->own->likely[f] = 1.0f / SHOCK_FILTERS;
    for (k = 0; k < packed_size(b); k++) p[k] = 0.0f;
    for (i = 0; i < n; i++) {
      mean[i] = (i == 0 || (i >= AIR && i < AIR + b->d->modes)) ? level : 0.0f;
      p[PACKED(i, i)] = (i >= WALK && i < AIR) ? square[f] * VARIANCE[i - WALK] : wide;
    }
    if (b->d->passing) {
      p[PACKED(n - 1, n - 1)] = c->passing * c->passing;
      p[PACKED(n - 2, n - 2)] = c->passing / c->speed * (c->passing / c->speed);
    }
  }
  b->own->started = 1;
}

/* Probabilities that the air goes over from one filter to another within a step. */
static void moves(float step_s, float move[SHOCK_FILTERS][SHOCK_FILTERS]) {
  float change, bend, bent, door, shut, after;
  uint8_t from, to;
  hold(step_s / @CHANGE_S@, &change, &after);
  hold(step_s / @BENDS_S@, &bend, &after);
  hold(step_s / @BEND_S@, &bent, &after);
  hold(step_s / @DOORS_S@, &door, &after);
  hold(step_s / @DOOR_S@, &shut, &after);
  for (from = 0; from < SHOCK_FILTERS; from++)
    for (to = 0; to < SHOCK_FILTERS; to++) {
      float calm = from == BENDING ? 0.5f * bent : from == DOOR ? 0.5f * shut : change;
      move[from][to] = to == DOOR ? door : to == BENDING ? (from == DOOR ? 0.0f : bend) : calm;
    }
  for (from = 0; from < SHOCK_FILTERS; from++) {
    float gone = 0.0f;
    for (to = 0; to < SHOCK_FILTERS; to++)
      if (to != from) gone += move[from][to];
    move[from][from] = 1.0f - gone;
  }
}

/* Every filter takes over from the others what they are worth. */
static void mix(bank *b, float step_s) {
  float share[SHOCK_FILTERS][SHOCK_FILTERS], likely[SHOCK_FILTERS], move[SHOCK_FILTERS][SHOCK_FILTERS];
  float mean[SHOCK_FILTERS][MOST_STATES];
  uint8_t to, from, i, j, n = b->d->size;
  size_t size = packed_size(b);
  moves(step_s, move);
  for (to = 0; to < SHOCK_FILTERS; to++) {
    float whole = 0.0f;
    likely[to] = 0.0f;
    for (from = 0; from < SHOCK_FILTERS; from++) {
      share[to][from] = move[from][to] * b->own->likely[from];
      likely[to] += share[to][from];
    }
    for (from = 0; from < SHOCK_FILTERS; from++) {
      share[to][from] = most(share[to][from] / likely[to] - @LEAST_SHARE@, 0.0f);
      whole += share[to][from];
    }
    for (from = 0; from < SHOCK_FILTERS; from++) share[to][from] /= whole;
    for (i = 0; i < n; i++) {
      /* differences: of numbers that are nearly equal, they keep their digits */
      float sum = 0.0f, first = b->mean[i];
      for (from = 1; from < SHOCK_FILTERS; from++) sum += share[to][from] * (b->mean[(size_t)from * n + i] - first);
      mean[to][i] = first + sum;
    }
  }
  for (i = 0; i < n; i++)
    for (j = 0; j <= i; j++) {
      float own[SHOCK_FILTERS];
      for (to = 0; to < SHOCK_FILTERS; to++) {
        own[to] = 0.0f;
        for (from = 0; from < SHOCK_FILTERS; from++) {
          const float *x = b->mean + (size_t)from * n;
          own[to] += share[to][from] *
                     (b->p[from * size + PACKED(i, j)] + (x[i] - mean[to][i]) * (x[j] - mean[to][j]));
        }
      }
      for (to = 0; to < SHOCK_FILTERS; to++) b->p[to * size + PACKED(i, j)] = own[to];
    }
  for (to = 0; to < SHOCK_FILTERS; to++) {
    b->own->likely[to] = likely[to];
    for (i = 0; i < n; i++) b->mean[(size_t)to * n + i] = mean[to][i];
  }
}

/* One step of straight air. */
static void advance(bank *b, float step_s, const float *values, const course *c) {
  move m;
  float q[AIR], total, square[SHOCK_FILTERS], bend[SHOCK_FILTERS], added_to[TURBULENT];
  float work[MOST_STATES][MOST_STATES], x[MOST_STATES], y[MOST_STATES];
  float own[3] = {0.0f, 0.0f, 0.0f}, cube = step_s * step_s * step_s / 3.0f;
  uint8_t i, j, f, n = b->d->size, modes = b->d->modes;
  strengths(b, square);
  bends(b, bend);
  m.step_s = step_s;
  for (i = 0; i < TURBULENT; i++) {
    m.gone[i] = expf(-RATE[i] * step_s);
    added_to[i] = VARIANCE[i] * (1.0f - m.gone[i] * m.gone[i]);
  }
  for (i = 0; i < modes; i++) {
    float gone;
    hold(expf(values[modes + i]) * step_s, &gone, &m.new_[i]);
    m.old[i] = gone - m.new_[i];
    m.decay[i] = 1.0f - gone;
  }
  if (b->d->passing) {
    float speed = c->speed, w = speed * step_s, fade = expf(-w), r = 1.0f / (speed * speed), *s = m.swing;
    float v = c->passing * c->passing;
    s[0] = fade * (1.0f + w);
    s[1] = fade * step_s;
    s[2] = -fade * speed * w;
    s[3] = fade * (1.0f - w);
    own[0] = v * most(r - (s[0] * s[0] * r + s[1] * s[1]), 0.0f);
    own[1] = -v * (s[2] * s[0] * r + s[3] * s[1]);
    own[2] = v * most(1.0f - (s[2] * s[2] * r + s[3] * s[3]), 0.0f);
  }
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float *mean = b->mean + (size_t)f * n, *p = b->p + f * packed_size(b), both = bend[f] * (step_s * step_s / 2.0f);
    total = q[0] = bend[f] * cube;
    q[1] = bend[f] * step_s;
    for (i = 0; i < TURBULENT; i++) {
      q[WALK + i] = square[f] * added_to[i];
      total += q[WALK + i];
    }
    carried(b, &m, mean, x);
    for (i = 0; i < n; i++) mean[i] = x[i];
    for (j = 0; j < n; j++) {
      for (i = 0; i < n; i++) x[i] = element(p, i, j);
      carried(b, &m, x, y);
      for (i = 0; i < n; i++) work[i][j] = y[i];
    }
    for (i = 0; i < n; i++) {
      carried(b, &m, work[i], y);
      for (j = 0; j <= i; j++) {
        float added = 0.0f;
        if (i >= AIR && i < AIR + modes) {
          float in = m.new_[i - AIR];
          if (j == 0)
            added = in * q[0];
          else if (j == 1)
            added = in * both;
          else if (j < AIR)
            added = in * q[j];
          else
            added = in * m.new_[j - AIR] * total;
        } else if (i < AIR && i == j)
          added = q[i];
        else if (i == 1 && j == 0)
          added = both;
        if (i >= AIR + modes && j >= AIR + modes) added = own[(i - AIR - modes) + (j - AIR - modes)];
        p[PACKED(i, j)] = y[j] + added;
      }
    }
  }
}

static void predict(bank *b, float step_s, const float *values, const course *c) {
  uint8_t parts = (uint8_t)within(step_s / b->d->straight_s + 0.5f, 1.0f, @MOST_PARTS@), i;
  float another, after;
  if (c->usual >= 0.0f) b->own->usual = possible(b, c->usual);
  hold(step_s / @CHANGE_S@, &another, &after);
  for (i = 0; i < SHOCK_STRENGTHS; i++) b->own->chance[i] += another * (b->d->before[i] - b->own->chance[i]);
  settle(b);
  mix(b, step_s);
  for (i = 0; i < parts; i++) advance(b, step_s / (float)parts, values, c);
}

static void update(bank *b, const float *on, float reading, float noise_variance) {
  float cost[SHOCK_FILTERS], off[SHOCK_FILTERS], own[SHOCK_FILTERS], low = INFINITY, sum = 0.0f;
  float pc[MOST_STATES], left[MOST_STATES], gain[MOST_STATES];
  uint8_t f, i, j, n = b->d->size;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    float *mean = b->mean + (size_t)f * n, *p = b->p + f * packed_size(b);
    float s, v = reading - dot(on, mean, n);
    own[f] = most(spread(b, p, on, pc), 0.0f);
    off[f] = v;
    s = own[f] + noise_variance;
    for (i = 0; i < n; i++) {
      /* no correlation is above one, whatever rounding has made of it */
      float bound = sqrtf(most(p[PACKED(i, i)], 0.0f) * s);
      pc[i] = within(pc[i], -bound, bound);
      gain[i] = pc[i] / s;
    }
    /* Joseph's form: what rounding leaves of a large variance in the direction of the reading is taken out again */
    for (i = 0; i < n; i++) {
      left[i] = 0.0f;
      for (j = 0; j < n; j++)
        if (on[j] != 0.0f) left[i] += (element(p, i, j) - gain[i] * pc[j]) * on[j];
    }
    for (i = 0; i < n; i++) {
      mean[i] += gain[i] * v;
      for (j = 0; j <= i; j++)
        p[PACKED(i, j)] = (p[PACKED(i, j)] - gain[i] * pc[j]) + (noise_variance * gain[i] - left[i]) * gain[j];
      p[PACKED(i, i)] = most(p[PACKED(i, i)], @LEAST_VARIANCE@);
    }
    cost[f] = 0.5f * (v * v / s + logf(s));
    low = least(low, cost[f]);
  }
  for (f = 0; f < SHOCK_FILTERS; f++) {
    b->own->likely[f] *= expf(most(low - cost[f], -@MOST_UNLIKELY@));
    sum += b->own->likely[f];
  }
  low = 0.0f;
  for (f = 0; f < SHOCK_FILTERS; f++) {
    b->own->likely[f] = most(b->own->likely[f] / sum, @LEAST_LIKELY@);
    low += b->own->likely[f];
  }
  for (f = 0; f < SHOCK_FILTERS; f++) b->own->likely[f] /= low;
  weigh(b, off, own, noise_variance);
}

/* The guard */

static const float DECIMAL_STEP[@DECIMAL_COUNT@ + 1] = {@DECIMAL_STEPS@, 0.0f}; /* the last: written in none of them */

/* Step of the log: before readings have changed, which in calm air they do not, the one that they are written in. */
static float resolution(const shock_guard *g) {
  return g->changes >= @FEWEST_CHANGES@ ? g->step : DECIMAL_STEP[g->decimals];
}

static int written_in(float reading, float step) {
  return fabsf(reading - step * floorf(reading / step + 0.5f)) <= @WRITTEN_WITHIN@;
}

static int is_coarse(const design *d, const shock_guard *g) { return resolution(g) > @COARSE@ * d->noise; }

static float white(const float *memory) {
  return within((memory[0] / most(memory[1], 1e-9f) - @WHITE@ + @SOFT@) / @SOFT@, 0.0f, 1.0f);
}

static float usual_noise(const float *memory) {
  return within(1.0f + white(memory) * (memory[0] - 1.0f), @LEAST_NOISE@, @MOST_NOISE@);
}

static float bursting(const shock_guard *g) {
  float times = g->burst[0] / usual_noise(g->usual);
  float loud = within(times / @LOUD@ - 1.0f, 0.0f, 1.0f) * white(g->burst);
  return 1.0f + loud * (times - 1.0f);
}

static void forget(shock_guard *g) {
  g->last = g->before = g->third = g->anchor = NAN;
  g->step = 0.0f;
  g->smallest = g->smallest_before = INFINITY;
  g->often = g->width = 0.0f;
  g->burst[0] = g->burst[1] = g->usual[0] = g->usual[1] = 1.0f;
  g->changes = g->stays = g->equal = g->unused = 0;
  g->refused = g->decimals = 0;
}

static void differences(const design *d, shock_guard *g, float reading, float alike) {
  float noise, size[2];
  uint8_t i;
  if (d->share > @MOST_SHARE@ || !isfinite(g->third)) return;
  noise = length(length(d->noise, resolution(g) / 3.4641016f), alike);
  size[0] = fabsf((reading - g->last) - 2.0f * (g->last - g->before) + (g->before - g->third)) / (@THIRD@ * noise);
  size[1] = fabsf(reading - g->last) / (@FIRST@ * noise);
  for (i = 0; i < 2; i++) {
    g->burst[i] += (least(size[i], @MOST_DIFFERENCE@) - g->burst[i]) / @BURST_ROWS@;
    g->usual[i] += (least(size[i], @MOST_DIFFERENCE@) - g->usual[i]) / @NOISE_ROWS@;
  }
}

static uint16_t one_more(uint16_t n) { return n < 60000u ? (uint16_t)(n + 1u) : n; }

/* Take in a reading that can be; whether it repeats the one before for no reason that rounding gives. */
static int believed(const design *d, shock_guard *g, float reading, float alike) {
  float change, step, by_chance;
  int same;
  while (g->decimals < @DECIMAL_COUNT@ && !written_in(reading, DECIMAL_STEP[g->decimals])) g->decimals++;
  if (!isfinite(g->last)) {
    g->last = g->anchor = reading;
    return 0;
  }
  change = fabsf(reading - g->last);
  same = change == 0.0f;
  g->equal = same ? one_more(g->equal) : 0;
  g->often += ((same ? 1.0f : 0.0f) - g->often) / @REPEATS_ROWS@;
  if (!same) {
    differences(d, g, reading, alike);
    g->changes = (uint16_t)(g->changes < 60000u ? g->changes + 1u : 60000u - @CHANGES_KEPT@u + 1u);
    g->width += (change - g->width) / least((float)g->changes, @REPEATS_ROWS@);
    g->smallest = least(g->smallest, change);
    if (g->changes % @CHANGES_KEPT@u == 0u) {
      g->smallest_before = g->smallest;
      g->smallest = INFINITY;
    }
    g->step = least(g->smallest, g->smallest_before);
    if (!isfinite(g->step)) g->step = change;
  }
  if (fabsf(reading - g->anchor) <= @LEVELS@ * resolution(g))
    g->stays = one_more(g->stays);
  else {
    g->anchor = reading;
    g->stays = 0;
  }
  g->third = g->before;
  g->before = g->last;
  g->last = reading;
  step = resolution(g);
  if (!same || step >= 1.5f * d->noise || g->changes < @FEWEST_CHANGES@) return 0;
  by_chance = least(step * @MEAN_SIZE@ / (2.5066283f * most(g->width, 1e-9f)), 1.0f);
  return g->equal > 1 || g->often > @TIMES_BY_CHANCE@ * most(by_chance, 1.0f / @REPEATS_ROWS@);
}

/* Readings in a row that noise alone does not keep within some steps of a level. */
static float kept_by_chance(const design *d, const shock_guard *g) {
  float step = resolution(g), x, share;
  if (step == 0.0f) return INFINITY;
  x = @LEVELS_PLAIN@ * step / (d->noise * 1.4142136f);
  share = erf_of(within_ends(x));
  if (!(share > 0.0f && share < 0.999f)) return INFINITY;
  return most(ceilf(@LN_BY_CHANCE@ / logf(share)), 5.0f);
}

static verdict judge(const design *d, shock_guard *g, float reading, float expected, float open_to, float alike) {
  verdict v = {0, 0, 0, 0, 0, 0.0f};
  float away, usual, share, farthest, noise, step;
  uint8_t i;
  if (!isfinite(reading)) {
    v.missing = 1;
    g->unused = one_more(g->unused);
    return v;
  }
  away = fabsf(reading - expected);
  usual = length(d->noise, resolution(g) / 3.4641016f) * usual_noise(g->usual);
  share = 1.0f - powf(1.0f - least(d->share, 0.999f), (float)g->unused + 1.0f);
  farthest = d->swing * share + length(@LONE@ * usual, @SPIKE@ * resolution(g)) + 4.0f * open_to;
  v.implausible = (uint8_t)!holds(reading, d->low, d->high);
  if (!v.implausible && away > most(@LEAST_JUMP@, @LONE@ * usual + 4.0f * open_to))
    for (i = 0; i < d->codes; i++)
      if (fabsf(reading - d->code[i]) <= @NEAR_CODE@) v.implausible = 1;
  if (!v.implausible && away > farthest) {
    g->refused = (uint8_t)(g->refused + 1u);
    if (g->refused >= @LASTING@) {
      /* it has lasted: the sensor is there, whatever it was before */
      forget(g);
      (void)believed(d, g, reading, 0.0f);
      v.usable = v.restart = 1;
      v.variance = d->noise * d->noise;
      return v;
    }
    v.implausible = 1;
  }
  if (v.implausible) {
    g->unused = one_more(g->unused);
    return v;
  }
  g->refused = 0;
  share = reading >= d->ceiling - 0.5f * resolution(g) ? 1.0f : 0.0f;
  v.repeated = (uint8_t)believed(d, g, reading, alike);
  step = resolution(g);
  noise = d->noise * usual_noise(g->usual) * bursting(g);
  /* readings on one coarse step are off by the same, and together say little more than one */
  v.variance = noise * noise + step * step / 12.0f * (is_coarse(d, g) ? 1.0f + (float)g->equal : 1.0f);
  if ((float)g->stays >= kept_by_chance(d, g)) v.repeated = 1;
  v.usable = (uint8_t)(share == 0.0f && !v.repeated);
  g->unused = v.usable ? 0 : one_more(g->unused);
  return v;
}

/* One channel of a row */

typedef struct {
  verdict judged;
  estimate air;
  float relative, readout, clean, step, slow[MOST_STATES];
} told;

static void take(bank *b, told *found, const shock_row *row, float step_s, float reading, float air_c, float own_c,
                 const course *c) {
  const design *d = b->d;
  float values[MOST_COLUMNS], readout[3], on[MOST_STATES], shown = reading, open_to = 0.0f;
  uint8_t f, i, n = d->size;
  float unit = b->unit;
  int unsure = !isfinite(row->airspeed_m_s);
  float airspeed = unsure ? @REFERENCE_AIRSPEED@ : row->airspeed_m_s;
  float pressure = isfinite(row->pressure_hpa) ? row->pressure_hpa : 1013.25f;
  look_up(&d->response, air_c, airspeed, pressure, values);
  look_up(&d->readout, own_c, airspeed, pressure, readout);
  found->readout = readout[2];
  found->relative = length(values[2 * d->modes], unsure ? d->unsure_of_airspeed : 0.0f);
  of_reading(b, values, on);
  b->own->since_used_s += step_s;
  b->own->since_read_s += step_s;
  if (b->own->started) {
    float off[SHOCK_FILTERS], variance[SHOCK_FILTERS];
    estimate expected;
    predict(b, step_s, values, c);
    expected = together(b, on, NULL, off, variance);
    shown = (expected.value / unit - readout[0]) / readout[1];
    open_to = sqrtf(expected.variance) / (readout[1] * unit);
  }
  found->judged = judge(d, &b->own->guard, reading, shown, open_to, c->alike);
  if (found->judged.usable || found->judged.repeated) b->own->since_read_s = 0.0f;
  if (found->judged.usable) {
    float level = (readout[0] + readout[1] * reading) * unit, scale = readout[1] * unit;
    b->own->since_used_s = 0.0f;
    if (found->judged.restart || !b->own->started) start(b, level, c);
    update(b, on, level, found->judged.variance * scale * scale);
  }
  found->step = is_coarse(d, &b->own->guard) ? resolution(&b->own->guard) * readout[1] * unit : 0.0f;
  found->air.value = found->air.variance = found->air.stated = found->clean = NAN;
  if (!b->own->started) return;
  found->air = air_ahead(b, d->delay_s, 1);
  found->clean = 0.0f;
  for (i = 0; i < d->modes; i++) {
    float lag = 0.0f;
    for (f = 0; f < SHOCK_FILTERS; f++) lag += b->own->likely[f] * b->mean[(size_t)f * n + AIR + i];
    found->clean += values[i] * lag;
    if (i >= d->modes - d->slow) found->slow[i - (d->modes - d->slow)] = lag;
  }
  b->own->shown = found->clean;
  if (d->passing)
    for (f = 0; f < SHOCK_FILTERS; f++) b->own->shown += b->own->likely[f] * b->mean[(size_t)(f + 1) * n - 1];
}

static float common(const design *d, const told *found) {
  float left = found->relative * (found->air.value - found->clean), total = left * left;
  uint8_t i;
  for (i = 0; i < d->slow; i++) {
    left = d->slow_uncertainty[i] * (found->air.value - found->slow[i]);
    total += left * left;
  }
  return sqrtf(total);
}

static int is_stale(const shock_channel *own, const told *found) {
  return own->since_used_s > @LONGEST_FILL@ && !(found->judged.repeated && own->since_used_s <= @LONGEST_REPEAT@);
}

static uint8_t said(const verdict *v) {
  return (uint8_t)((v->missing ? SHOCK_MISSING : 0) | (v->repeated ? SHOCK_REPEATED : 0) |
                   (v->implausible ? SHOCK_IMPLAUSIBLE : 0));
}

static float resolved_rate(const bank *b) {
  float low = logf(b->d->lowest), high = logf(b->d->highest);
  float at = within((logf(b->own->middle) - low) / (high - low), 0.0f, 1.0f) * (@STRENGTHS@ - 1);
  uint8_t i = (uint8_t)at;
  if (i > @STRENGTHS@ - 2) i = @STRENGTHS@ - 2;
  return expf(b->d->ln_resolved[i] + (at - (float)i) * (b->d->ln_resolved[i + 1] - b->d->ln_resolved[i]));
}

static bank bead_of(shock_state *state) {
  return (bank){&BEAD, &state->bead, state->bead_mean, state->bead_p, 1.0f};
}

static bank film_of(shock_state *state) {
  return (bank){&FILM, &state->film, state->film_mean, state->film_p, 1.0f};
}

static void anew(shock_channel *own) {
  own->started = 0;
  own->since_used_s = own->since_read_s = INFINITY;
  own->shown = NAN;
  forget(&own->guard);
}

void shock_begin(shock_state *state) {
  size_t i;
  for (i = 0; i < sizeof(*state); i++) ((unsigned char *)state)[i] = 0;
  state->airspeed_m_s = state->pressure_hpa = state->reading_c = state->last_c = state->before_c = NAN;
  anew(&state->bead);
  anew(&state->film);
}

/* Of times of any size, which may wrap. */
static int64_t apart(int64_t a, int64_t b) { return (int64_t)((uint64_t)a - (uint64_t)b); }

/* The clock: whether a row follows the ones before, and how long after. */
static int in_order(shock_state *state, int64_t time_us, float *step_s) {
  const int64_t longest = @LONGEST_US@;
  int64_t ahead = apart(time_us, state->time_us);
  int begins = !state->begun || ahead <= 0 || ahead > longest;
  if (state->begun && ahead <= 0) {
    int64_t on = apart(time_us, state->stray_us);
    state->strays = (uint8_t)(state->strayed && on > 0 && on <= longest ? state->strays + 1 : 1);
    state->stray_us = time_us;
    state->strayed = 1;
    if (state->strays < @FEWEST_ROWS@) return 0;
  }
  *step_s = begins ? 0.0f : (float)ahead * 1e-6f;
  state->strays = state->strayed = 0;
  state->time_us = time_us;
  state->begun = 1;
  if (begins) {
    anew(&state->bead);
    anew(&state->film);
    state->last_c = state->before_c = NAN;
  }
  return 1;
}

static const course PLAIN = {0.0f, 1.0f, 0.0f, -1.0f};

static void warm(shock_state *state, const shock_row *row, float step_s, told *found) {
  bank b = bead_of(state);
  /* where the lags stand: the reading itself, which may be absurd, is no place in a table */
  float shown = b.own->started ? b.own->shown : state->reading_c;
  if (!isfinite(shown)) shown = 20.0f;
  take(&b, found, row, step_s, row->temperature_c, shown, shown, &PLAIN);
}

/* Nothing that air can be is farther away than the farther end of that. */
static float farthest_temperature(float c) { return most(c + 100.0f, 150.0f - c); }

static void give_temperature(const bank *b, const told *found, shock_air *air) {
  float own, shared, value;
  air->temperature_flags = said(&found->judged);
  if (!b->own->started || is_stale(b->own, found)) return;
  shared = length(common(b->d, found), length(found->readout, b->d->left));
  own = most(found->air.stated, found->step * found->step / 12.0f);
  value = within(found->air.value, -100.0f, 150.0f);
  air->temperature_c = value;
  air->temperature_uncertainty_k = least(sqrtf(own + shared * shared), farthest_temperature(value));
}

/* Nothing between dry and saturated is farther away than the farther of the two. */
static float farthest_humidity(float percent) { return most(percent, 100.0f - percent); }

static void humid(shock_state *state, const shock_row *row, float step_s, const told *bead, shock_air *air) {
  bank b = film_of(state), warmth = bead_of(state);
  told found;
  estimate then;
  float now_c, then_c, own, held, back, sigma, bend, level, value, away;
  course c = PLAIN;
  float shared, readout, total;
  /* where the bead tells how warm the film is, its reading without the noise */
  float die_c = BESIDE_BEAD ? warmth.own->shown : row->die_temperature_c;
  int read = holds(die_c, -100.0f, 150.0f), at_die = DIE_SHARE > 0.0f && read;
  if (!warmth.own->started) {
    air->humidity_flags = SHOCK_MISSING;
    return;
  }
  then = air_ahead(&warmth, warmth.d->delay_s - b.d->delay_s, 0);
  now_c = within(bead->air.value, b.d->low_c - FAR_C, b.d->high_c + FAR_C);
  then_c = within(then.value, b.d->low_c - FAR_C, b.d->high_c + FAR_C);
  sigma = sqrtf(bead->air.stated);
  die_c = within(die_c, b.d->low_c - FAR_C, b.d->high_c + FAR_C);
  own = saturation(at_die ? then_c + DIE_SHARE * (die_c - then_c) : then_c);
  held = BY_ACTIVITY ? own : saturation(20.0f);
  b.unit = own / held;
  back = held / saturation(now_c);
  bend = fabsf((now_c - state->last_c) - (state->last_c - state->before_c)) / 2.0f;
  state->before_c = state->last_c;
  state->last_c = now_c;
  level = fabsf(b.own->started ? b.own->shown : row->humidity_percent * own / held);
  c.speed = resolved_rate(&warmth);
  if (isfinite(level)) {
    c.usual = @VAPOUR@ * level * warmth.own->middle;
    if (!at_die && !BY_ACTIVITY) {
      c.passing = level * steepness(now_c) * length(sqrtf(bead->air.variance), isfinite(bend) ? bend : 0.0f);
      c.alike = level * held / own * steepness(now_c) * wobble(&warmth, @PERIOD_STEP@);
    }
  }
  take(&b, &found, row, step_s, warmth.own->since_read_s <= UNREAD_S ? row->humidity_percent : NAN, now_c,
       read ? die_c : now_c, &c);
  air->humidity_flags = said(&found.judged);
  if (!b.own->started || is_stale(b.own, &found)) return;
  value = found.air.value * back;
  readout = length(found.readout, b.d->left);
  shared = common(b.d, &found) * back;
  total = most(found.air.stated, found.step * found.step / 12.0f) * back * back + shared * shared;
  if (at_die || BY_ACTIVITY) {
    away = value * steepness(now_c) * sigma;
    total += away * away;
  }
  if (!holds(now_c, b.d->low_c, b.d->high_c)) {
    /* the profile does not speak for such air: the reading, as unsure as what the correction would have made of it */
    air->humidity_flags |= SHOCK_OUTSIDE;
    if (!(found.judged.usable || found.judged.repeated)) return;
    air->humidity_flags |= SHOCK_AS_READ;
    away = row->humidity_percent - value;
    air->humidity_percent = row->humidity_percent;
    total = sqrtf(total + readout * readout + away * away);
    air->humidity_uncertainty_percent = least(total, farthest_humidity(row->humidity_percent));
    return;
  }
  value = within(value, 0.0f, 100.0f);
  air->humidity_percent = value;
  air->humidity_uncertainty_percent = length(least(sqrtf(total), farthest_humidity(value)), readout);
}

void shock_step(shock_state *state, const shock_row *row, shock_air *air) {
  float step_s;
  shock_row here = *row;
  told found;
  bank b;
  air->temperature_c = air->temperature_uncertainty_k = NAN;
  air->humidity_percent = air->humidity_uncertainty_percent = NAN;
  air->temperature_flags = air->humidity_flags = SHOCK_IMPLAUSIBLE;
  if (!in_order(state, row->time_us, &step_s)) return;
  if (holds(row->airspeed_m_s, 0.0f, 150.0f)) state->airspeed_m_s = row->airspeed_m_s;
  if (holds(row->pressure_hpa, 1.0f, 2000.0f)) state->pressure_hpa = row->pressure_hpa;
  if (holds(row->temperature_c, -100.0f, 150.0f)) state->reading_c = row->temperature_c;
  here.airspeed_m_s = state->airspeed_m_s;
  here.pressure_hpa = state->pressure_hpa;
  b = bead_of(state);
  warm(state, &here, step_s, &found);
  give_temperature(&b, &found, air);
  humid(state, &here, step_s, &found, air);
}
