/* The smoother's recursions compiled: what `smoother.plain` does, window by window, with the structure of the model.
 *
 * States: level, slope, curvature, three eddies, K lags (first J of a cap, then M inside it), and (place, speed) of what
 * passes. `apply` is a step's transition on n row vectors at once, `apply_back` its transpose; both run along rows, so
 * phi P phi' is apply, transpose, apply. No NumPy in here: buffers of doubles, one build for every Python from 3.11.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SOURCE "12ad298c06d7e718" /* files/compiled.py */

#define AIR 6
#define TREND 3
#define EDDIES 3
#define MOST 32 /* states */
#define ASKEW 16 /* steps after which rounding's skew part is taken out of a covariance */
#if defined(_MSC_VER)
#define INLINE static __forceinline
#else
#define INLINE static inline __attribute__((always_inline))
#endif

/* Four doubles at a time where the processor can; each is rounded as one alone would be. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDER __attribute__((target_clones("avx2", "default")))
#else
#define WIDER
#endif

typedef struct {
    Py_ssize_t windows, count;
    int modes, caps, inside, smooth, passing, backward, leaps;
    double passing_rate, coupling;
    double eddy_rate[EDDIES], eddy_variance[EDDIES];
    const double *step, *reading, *noise, *weight, *old, *new, *decay, *fed, *leap_level, *leap_slope, *rest;
    const double *turbulence, *bend, *passing_sigma, *jump, *mean, *covariance;
    double *air, *variance, *clean, *clean_variance, *surprise, *size, *score, *cost;
} Task;

/* One step of the model. */
typedef struct {
    double h, half_square, eddy[EDDIES], swing[4];
    const double *old, *new, *decay, *fed;
} Move;

INLINE double dot(const double *a, const double *b, int n) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* rows <- phi rows, `wide` numbers a row */
INLINE void apply(const Task *t, const Move *m, double rows[][MOST], int wide) {
    double before[MOST], after[MOST];
    const int modes = t->modes, speed = AIR + modes + 1;
    double(*lag)[MOST] = rows + AIR;
    for (int j = 0; j < wide; j++) before[j] = rows[0][j] + rows[3][j] + rows[4][j] + rows[5][j];
    if (t->coupling != 0.0)
        for (int j = 0; j < wide; j++) before[j] += t->coupling * rows[speed][j];
    for (int j = 0; j < wide; j++) rows[0][j] += m->h * rows[1][j] + m->half_square * rows[2][j];
    for (int j = 0; j < wide; j++) rows[1][j] += m->h * rows[2][j];
    for (int i = 0; i < EDDIES; i++)
        for (int j = 0; j < wide; j++) rows[TREND + i][j] *= m->eddy[i];
    if (t->passing)
        for (int j = 0; j < wide; j++) {
            const double place = rows[speed - 1][j], own = rows[speed][j];
            rows[speed - 1][j] = m->swing[0] * place + m->swing[1] * own;
            rows[speed][j] = m->swing[2] * place + m->swing[3] * own;
        }
    for (int j = 0; j < wide; j++) after[j] = rows[0][j] + rows[3][j] + rows[4][j] + rows[5][j];
    if (t->coupling != 0.0)
        for (int j = 0; j < wide; j++) after[j] += t->coupling * rows[speed][j];
    for (int k = modes - 1; k >= 0; k--) { /* the cap's own come last: what follows them needs them as they were */
        const double d = m->decay[k], o = m->old[k], w = m->new[k];
        for (int j = 0; j < wide; j++) lag[k][j] = d * lag[k][j] + o * before[j] + w * after[j];
        if (k >= t->caps && k < t->caps + t->inside)
            for (int c = 0; c < t->caps; c++) {
                const double fed = m->fed[(k - t->caps) * t->caps + c];
                for (int j = 0; j < wide; j++) lag[k][j] += fed * lag[c][j];
            }
    }
}

/* rows <- phi' rows */
INLINE void apply_back(const Task *t, const Move *m, double rows[][MOST], int wide) {
    double before[MOST] = {0}, after[MOST] = {0};
    const int modes = t->modes, speed = AIR + modes + 1;
    double(*lag)[MOST] = rows + AIR;
    for (int k = 0; k < modes; k++) {
        const double o = m->old[k], w = m->new[k];
        for (int j = 0; j < wide; j++) before[j] += o * lag[k][j];
        for (int j = 0; j < wide; j++) after[j] += w * lag[k][j];
    }
    for (int c = 0; c < t->caps; c++) {
        for (int j = 0; j < wide; j++) lag[c][j] *= m->decay[c];
        for (int k = 0; k < t->inside; k++) {
            const double fed = m->fed[k * t->caps + c];
            for (int j = 0; j < wide; j++) lag[c][j] += fed * lag[t->caps + k][j];
        }
    }
    for (int k = t->caps; k < modes; k++)
        for (int j = 0; j < wide; j++) lag[k][j] *= m->decay[k];
    for (int j = 0; j < wide; j++) {
        const double level = rows[0][j] + after[j], slope = rows[1][j];
        rows[0][j] = level + before[j];
        rows[1][j] = slope + m->h * level;
        rows[2][j] += m->h * slope + m->half_square * level;
    }
    for (int i = 0; i < EDDIES; i++)
        for (int j = 0; j < wide; j++) rows[TREND + i][j] = m->eddy[i] * (rows[TREND + i][j] + after[j]) + before[j];
    if (t->passing)
        for (int j = 0; j < wide; j++) {
            const double place = rows[speed - 1][j], own = rows[speed][j] + t->coupling * after[j];
            rows[speed - 1][j] = m->swing[0] * place + m->swing[2] * own;
            rows[speed][j] = m->swing[1] * place + m->swing[3] * own + t->coupling * before[j];
        }
}

/* Not in place: rows are written whole, and a processor waits for what it reads wider than it was written. */
INLINE void transpose(double (*from)[MOST], double (*to)[MOST], int n) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) to[i][j] = from[j][i];
}

/* No reading takes out of a covariance what rounding makes of it that is not symmetric, and where the air is a thousand
 * times drier than it was that is all there is. */
INLINE void symmetrize(double p[][MOST], int n) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) p[i][j] = p[j][i] = 0.5 * (p[i][j] + p[j][i]);
}

INLINE void swap(double (**a)[MOST], double (**b)[MOST]) {
    double(*keep)[MOST] = *a;
    *a = *b;
    *b = keep;
}

/* What a step adds to the covariance: the trend's walk, the eddies and what passes, each also through the lags. */
INLINE void add_innovation(const Task *t, const Move *m, Py_ssize_t at, double p[][MOST], int n) {
    const double h = m->h, bend = t->bend[at] * t->bend[at], strength = t->turbulence[at] * t->turbulence[at];
    const int modes = t->modes, lag = AIR, last = t->smooth ? 2 : 1;
    static const double factorial[3] = {1.0, 1.0, 2.0};
    double trend[3][3] = {{0}}, to_air[MOST] = {0}, own = 0.0;
    double power[6] = {1.0};
    for (int i = 1; i < 6; i++) power[i] = power[i - 1] * h;
    for (int i = 0; i <= last; i++)
        for (int j = 0; j <= last; j++) {
            const int exponent = 2 * last - i - j + 1;
            trend[i][j] = bend * power[exponent] / (exponent * factorial[last - i] * factorial[last - j]);
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) p[i][j] += trend[i][j];
    for (int i = 0; i < 3; i++) to_air[i] = trend[i][0];
    own = trend[0][0];
    for (int i = 0; i < EDDIES; i++) {
        const double added = strength * t->eddy_variance[i] * (1.0 - m->eddy[i] * m->eddy[i]);
        p[TREND + i][TREND + i] += added;
        to_air[TREND + i] = added;
        own += added;
    }
    if (t->passing) {
        const int place = AIR + modes, speed = place + 1;
        const double rate2 = t->passing_rate * t->passing_rate, sigma2 = t->passing_sigma[at] * t->passing_sigma[at];
        const double *s = m->swing;
        const double a = sigma2 * (1.0 / rate2 - s[0] * s[0] / rate2 - s[1] * s[1]);
        const double b = sigma2 * (-s[0] * s[2] / rate2 - s[1] * s[3]);
        const double c = sigma2 * (1.0 - s[2] * s[2] / rate2 - s[3] * s[3]);
        p[place][place] += a;
        p[place][speed] += b;
        p[speed][place] += b;
        p[speed][speed] += c;
        to_air[place] = t->coupling * b;
        to_air[speed] = t->coupling * c;
        own += t->coupling * t->coupling * c;
    }
    for (int k = 0; k < modes; k++) {
        const double through = m->new[k];
        for (int j = 0; j < n; j++) p[lag + k][j] += through * to_air[j];
        for (int j = 0; j < n; j++) p[j][lag + k] += through * to_air[j];
        for (int l = 0; l < modes; l++) p[lag + k][lag + l] += through * m->new[l] * own;
    }
}

INLINE void set_move(const Task *t, Py_ssize_t at, Move *m) {
    const int k = t->modes;
    const double h = t->step[at];
    m->old = t->old + at * k;
    m->new = t->new + at * k;
    m->decay = t->decay + at * k;
    m->fed = t->fed + at * t->caps * t->inside;
    if (h == m->h) return;
    m->h = h;
    m->half_square = 0.5 * h * h;
    for (int i = 0; i < EDDIES; i++) m->eddy[i] = exp(-t->eddy_rate[i] * h);
    if (t->passing) {
        const double x = t->passing_rate * h, fall = exp(-x);
        m->swing[0] = fall * (1.0 + x);
        m->swing[1] = fall * x / t->passing_rate;
        m->swing[2] = -fall * t->passing_rate * x;
        m->swing[3] = fall * (1.0 - x);
    }
}

/* The state that a jump by one of the air, or of its slope, leaves at the step's end. */
INLINE void set_leap(const Task *t, Py_ssize_t at, double leap[2][MOST], int n) {
    memset(leap, 0, 2 * sizeof *leap);
    leap[0][0] = 1.0;
    leap[1][0] = t->rest[at];
    leap[1][1] = 1.0;
    memcpy(leap[0] + AIR, t->leap_level + at * t->modes, t->modes * sizeof(double));
    memcpy(leap[1] + AIR, t->leap_slope + at * t->modes, t->modes * sizeof(double));
    (void)n;
}

INLINE void run_window(const Task *t, Py_ssize_t window, double *kept, const int n) {
    const int modes = t->modes, speed = n - 1;
    const Py_ssize_t count = t->count, first = window * count;
    /* for each sample: mean, covariance with the air, covariance with the reading, its variance, innovation, air's */
    const int per = 3 * n + 3;
    double first_p[MOST][MOST], other_p[MOST][MOST], c[MOST] = {0}, h[MOST] = {0}, leap[2][MOST];
    double(*p)[MOST] = first_p, (*other)[MOST] = other_p;
    double mean[MOST][MOST]; /* one column, so that `apply` takes it */
    Move move = {.h = -1.0};
    h[0] = h[3] = h[4] = h[5] = 1.0;
    if (t->passing) {
        c[speed] = 1.0;
        h[speed] = 1.0 + t->coupling;
    }
    for (int i = 0; i < n; i++) {
        mean[i][0] = t->mean[window * n + i];
        for (int j = 0; j < n; j++) p[i][j] = t->covariance[(window * n + i) * n + j];
    }
    for (Py_ssize_t k = 0; k < count; k++) {
        const Py_ssize_t at = first + k;
        double *keep = kept + k * per, *ph = keep + n, *pc = ph + n;
        const double noise = t->noise[at];
        const int seen = isfinite(noise);
        if (k) {
            set_move(t, at, &move);
            apply(t, &move, mean, 1);
            apply(t, &move, p, n);
            transpose(p, other, n);
            apply(t, &move, other, n);
            swap(&p, &other);
            if (k % ASKEW == 0) symmetrize(p, n);
            add_innovation(t, &move, at, p, n);
            if (t->leaps && (t->jump[2 * at] != 0.0 || t->jump[2 * at + 1] != 0.0)) {
                set_leap(t, at, leap, n);
                for (int kind = 0; kind < 2; kind++)
                    for (int i = 0; i < n; i++) {
                        const double by = t->jump[2 * at + kind] * leap[kind][i];
                        for (int j = 0; j < n; j++) p[i][j] += by * leap[kind][j];
                    }
            }
        }
        memcpy(c + AIR, t->weight + at * modes, modes * sizeof(double));
        double shown = 0.0, spread = 0.0, air = 0.0;
        for (int i = 0; i < n; i++) {
            keep[i] = mean[i][0];
            pc[i] = ph[i] = 0.0;
        }
        /* symmetric: columns taken as rows */
        for (int i = 0; i < n; i++) {
            if (c[i] != 0.0)
                for (int j = 0; j < n; j++) pc[j] += c[i] * p[i][j];
            if (h[i] != 0.0)
                for (int j = 0; j < n; j++) ph[j] += h[i] * p[i][j];
        }
        for (int i = 0; i < n; i++) {
            shown += c[i] * mean[i][0];
            spread += c[i] * pc[i];
            air += h[i] * ph[i];
        }
        const double s = seen ? fmax(spread, 0.0) + noise : INFINITY;
        const double v = seen ? t->reading[at] - shown : 0.0;
        keep[3 * n] = s;
        keep[3 * n + 1] = v;
        keep[3 * n + 2] = air;
        if (seen) {
            for (int i = 0; i < n; i++) {
                const double gain = pc[i] / s;
                mean[i][0] += gain * v;
                for (int j = 0; j < n; j++) p[i][j] -= gain * pc[j];
            }
        }
        t->cost[at] = seen ? 0.5 * (log(s) + v * v / s) : 0.0;
        t->surprise[at] = seen ? v / sqrt(s) : NAN;
    }
    if (!t->backward) return;

    double small[MOST][MOST];
    double(*big)[MOST] = p;
    for (int i = 0; i < n; i++) {
        small[i][0] = 0.0;
        for (int j = 0; j < n; j++) big[i][j] = 0.0;
    }
    for (Py_ssize_t k = count - 1; k >= 0; k--) {
        const Py_ssize_t at = first + k;
        const double *keep = kept + k * per, *ph = keep + n, *pc = ph + n;
        const double s = keep[3 * n], v = keep[3 * n + 1];
        if (k < count - 1) {
            set_move(t, at + 1, &move);
            apply_back(t, &move, small, 1);
            apply_back(t, &move, big, n);
            transpose(big, other, n);
            apply_back(t, &move, other, n);
            swap(&big, &other);
        }
        memcpy(c + AIR, t->weight + at * modes, modes * sizeof(double));
        if (isfinite(s)) {
            double gain[MOST], through[MOST] = {0}, pulled = 0.0, both = 1.0 / s;
            for (int i = 0; i < n; i++) gain[i] = pc[i] / s;
            for (int i = 0; i < n; i++)
                for (int j = 0; j < n; j++) through[j] += gain[i] * big[i][j];
            for (int i = 0; i < n; i++) {
                both += gain[i] * through[i];
                pulled += gain[i] * small[i][0];
            }
            for (int i = 0; i < n; i++) through[i] -= 0.5 * both * c[i];
            for (int i = 0; i < n; i++) {
                const double own = c[i], other = through[i];
                for (int j = 0; j < n; j++) big[i][j] -= own * through[j] + other * c[j];
                small[i][0] -= own * (pulled + v / s);
            }
        }
        if (t->leaps) set_leap(t, at, leap, n);
        const double *asked[4] = {ph, pc, leap[0], leap[1]};
        double of[4], pull[4];
        for (int q = 0; q < (t->leaps ? 4 : 2); q++) {
            double seen_by[MOST] = {0};
            of[q] = pull[q] = 0.0;
            for (int i = 0; i < n; i++)
                if (asked[q][i] != 0.0)
                    for (int j = 0; j < n; j++) seen_by[j] += asked[q][i] * big[i][j];
            for (int i = 0; i < n; i++) {
                of[q] += asked[q][i] * seen_by[i];
                pull[q] += asked[q][i] * small[i][0];
            }
        }
        t->air[at] = dot(h, keep, n) - pull[0];
        t->clean[at] = dot(c, keep, n) - pull[1];
        t->variance[at] = fmax(keep[3 * n + 2] - of[0], 0.0);
        t->clean_variance[at] = fmax(dot(c, pc, n) - of[1], 0.0);
        for (int kind = 0; t->leaps && kind < 2; kind++) {
            const double hold = fmax(of[2 + kind], 1e-300), by = k ? pull[2 + kind] : 0.0;
            t->size[2 * at + kind] = -by / hold;
            t->score[2 * at + kind] = -by / sqrt(hold);
        }
    }
}

/* The same for a number of states that the compiler knows, where it is a usual one. */
WIDER static void run(const Task *t, double *kept, int n) {
    for (Py_ssize_t window = 0; window < t->windows; window++) switch (n) {
            case 10: run_window(t, window, kept, 10); break;
            case 12: run_window(t, window, kept, 12); break;
            case 14: run_window(t, window, kept, 14); break;
            default: run_window(t, window, kept, n);
        }
}

enum { ARRAYS = 25 };

static PyObject *smooth(PyObject *module, PyObject *args) {
    (void)module;
    Task t = {0};
    PyObject *given[ARRAYS], *eddies;
    if (!PyArg_ParseTuple(args, "(nniiipppp)(dd)OO!", &t.windows, &t.count, &t.modes, &t.caps, &t.inside, &t.smooth,
                          &t.passing, &t.backward, &t.leaps, &t.passing_rate, &t.coupling, &eddies, &PyTuple_Type, &given[0]))
        return NULL;
    PyObject *tuple = given[0];
    const int n = AIR + t.modes + 2 * t.passing;
    if (n > MOST || t.caps + t.inside > t.modes || PyTuple_Size(tuple) != ARRAYS) {
        PyErr_SetString(PyExc_ValueError, "arrays that do not fit one another");
        return NULL;
    }
    const Py_ssize_t nodes = t.windows * t.count, leaps = t.leaps ? nodes : 0;
    const Py_ssize_t sizes[ARRAYS] = {
        nodes, nodes, nodes, nodes * t.modes, nodes * t.modes, nodes * t.modes, nodes * t.modes,
        nodes * t.caps * t.inside, leaps * t.modes, leaps * t.modes, leaps, nodes, nodes, t.passing ? nodes : 0,
        2 * leaps, t.windows * n, t.windows * n * n,
        nodes, nodes, nodes, nodes, nodes, 2 * leaps, 2 * leaps, nodes};
    const double **inputs[] = {&t.step, &t.reading, &t.noise, &t.weight, &t.old, &t.new, &t.decay, &t.fed,
                               &t.leap_level, &t.leap_slope, &t.rest, &t.turbulence, &t.bend, &t.passing_sigma,
                               &t.jump, &t.mean, &t.covariance};
    double **outputs[] = {&t.air, &t.variance, &t.clean, &t.clean_variance, &t.surprise, &t.size, &t.score, &t.cost};
    enum { INPUTS = sizeof inputs / sizeof *inputs };
    Py_buffer views[ARRAYS];
    int held = 0;
    PyObject *result = NULL;
    double *kept = NULL;
    Py_buffer of_eddies;
    if (PyObject_GetBuffer(eddies, &of_eddies, PyBUF_C_CONTIGUOUS) < 0) return NULL;
    if (of_eddies.len == (Py_ssize_t)(2 * EDDIES * sizeof(double))) {
        memcpy(t.eddy_rate, of_eddies.buf, sizeof t.eddy_rate);
        memcpy(t.eddy_variance, (const double *)of_eddies.buf + EDDIES, sizeof t.eddy_variance);
    } else
        PyErr_SetString(PyExc_ValueError, "rates and variances of three eddies are expected");
    PyBuffer_Release(&of_eddies);
    if (PyErr_Occurred()) return NULL;
    for (; held < ARRAYS; held++) {
        const int flags = PyBUF_C_CONTIGUOUS | (held < INPUTS ? 0 : PyBUF_WRITABLE);
        if (PyObject_GetBuffer(PyTuple_GetItem(tuple, held), &views[held], flags) < 0) goto done;
        if (views[held].itemsize != sizeof(double) || views[held].len != sizes[held] * (Py_ssize_t)sizeof(double)) {
            held++;
            PyErr_Format(PyExc_ValueError, "array %d is not of the size that the others ask for", held - 1);
            goto done;
        }
        if (held < INPUTS)
            *inputs[held] = views[held].buf;
        else
            *outputs[held - INPUTS] = views[held].buf;
    }
    kept = malloc((size_t)(t.count > 0 ? t.count : 1) * (3 * n + 3) * sizeof(double));
    if (kept == NULL) {
        PyErr_NoMemory();
        goto done;
    }
    Py_BEGIN_ALLOW_THREADS;
    run(&t, kept, n);
    Py_END_ALLOW_THREADS;
    result = Py_NewRef(Py_None);
done:
    free(kept);
    while (held > 0) PyBuffer_Release(&views[--held]);
    return result;
}

/* follow(values, decay, start, out): out[k] = decay out[k - 1] + (1 - decay) values[k], out[-1] = start. */
static PyObject *follow(PyObject *module, PyObject *args) {
    (void)module;
    PyObject *given, *written;
    Py_buffer values, out;
    double decay, state;
    if (!PyArg_ParseTuple(args, "OddO", &given, &decay, &state, &written)) return NULL;
    if (PyObject_GetBuffer(given, &values, PyBUF_C_CONTIGUOUS) < 0) return NULL;
    if (PyObject_GetBuffer(written, &out, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE) < 0) {
        PyBuffer_Release(&values);
        return NULL;
    }
    const int fits = values.len == out.len && values.itemsize == sizeof(double) && out.itemsize == sizeof(double);
    const double *x = values.buf;
    double *y = out.buf;
    for (Py_ssize_t k = 0; fits && k < values.len / (Py_ssize_t)sizeof(double); k++)
        y[k] = state = decay * state + (1.0 - decay) * x[k];
    PyBuffer_Release(&values);
    PyBuffer_Release(&out);
    if (fits) return Py_NewRef(Py_None);
    PyErr_SetString(PyExc_ValueError, "arrays of doubles of one size are expected");
    return NULL;
}

static PyMethodDef methods[] = {{"smooth", smooth, METH_VARARGS, "Smooth windows of readings."},
                                {"follow", follow, METH_VARARGS, "A lag of first order behind held values."},
                                {NULL, NULL, 0, NULL}};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef kernel = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_kernel", .m_doc = SOURCE, .m_size = 0,
    .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&kernel); }
