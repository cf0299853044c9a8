/* Sums of exponentials compiled: what `exponentials.plain` does, leaving out what has died out by each few times; and
 * modes that a trace drives, piece by piece: what `driven.plain` does.
 *
 * exp is a polynomial about the nearest power of two, off by less than two units of the last place, without calls or
 * branches: a processor takes several times at once, and every one gives the same numbers (no contraction).
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#define SOURCE "e55625124caf6763" /* files/compiled.py */

#define WIDE 4 /* numbers in one register */
#define TIMES (2 * WIDE) /* taken together: a processor begins the second before it is done with the first */
#define LEAST -700.0 /* exp of less is nothing */

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDER __attribute__((target_clones("avx2", "default")))
#else
#define WIDER
#endif
#define INLINE static inline __attribute__((always_inline))

static const double PER_LN2 = 1.4426950408889634, LN2_HIGH = 6.93147180369123816490e-01,
                    LN2_LOW = 1.90821492927058770002e-10, TO_WHOLE = 6755399441055744.0; /* 1.5 2^52 */

typedef double Doubles __attribute__((vector_size(8 * WIDE)));
typedef int64_t Integers __attribute__((vector_size(8 * WIDE)));

/* exp(x) as 1 + the first times 2^n, which is the second: exp(x) = second (first + 1) and exp(x) - 1 =
 * second first + (second - 1). Nothing for an x below LEAST; what is no number stays none. */
INLINE void exponential(const Doubles *given, Doubles *first, Doubles *second) {
    const Doubles least = (Doubles){0} + LEAST;
    const Integers told = ~(*given <= least);
    const Doubles x = (Doubles)(((Integers)*given & told) | ((Integers)least & ~told));
    const Doubles whole = x * PER_LN2 + TO_WHOLE, turns = whole - TO_WHOLE;
    const Doubles r = (x - turns * LN2_HIGH) - turns * LN2_LOW, s = r * r;
    Doubles even = s * (1.0 / 479001600.0) + 1.0 / 3628800.0, odd = s * (1.0 / 39916800.0) + 1.0 / 362880.0;
    even = even * s + 1.0 / 40320.0;
    odd = odd * s + 1.0 / 5040.0;
    even = even * s + 1.0 / 720.0;
    odd = odd * s + 1.0 / 120.0;
    even = even * s + 1.0 / 24.0;
    odd = odd * s + 1.0 / 6.0;
    even = even * s + 0.5;
    odd = odd * s + 1.0;
    *first = even * s + odd * r;
    *second = (Doubles)((((Integers)whole << 52) + (1023LL << 52)) & told);
}

/* sum += amplitude exp(-rate t), for rate t that is not negative */
INLINE void add_exponential(Doubles *sum, double amplitude, double rate, const Doubles *t) {
    const Doubles given = -rate * *t;
    Doubles first, second;
    exponential(&given, &first, &second);
    *sum += amplitude * ((first + 1.0) * second);
}

/* exp(-rate t) - 1 of several modes at one time, right also where it is next to nothing */
INLINE void forget(const Doubles *rate, double t, Doubles *change) {
    const Doubles given = *rate * -t;
    Doubles first, second;
    exponential(&given, &first, &second);
    *change = second * first + (second - 1.0);
}

/* out (rows, count) = sum over k of amplitude_k exp(-rate_k t), without modes that are less than exp(-died_out) of the
 * step by then; `places` (3, rows) is where each row's times, rates and amplitudes begin. Rates come as ascending
 * pieces, one for each response and lag that were put together: `ends` (modes) is room for where these end. */
WIDER static void run(Py_ssize_t rows, Py_ssize_t count, Py_ssize_t modes, const int64_t *places, const double *times,
                      const double *rates, const double *amplitudes, double died_out, Py_ssize_t *ends, double *out) {
    for (Py_ssize_t row = 0; row < rows; row++, out += count) {
        const double *t = times + places[row], *rate = rates + places[rows + row];
        const double *amplitude = amplitudes + places[2 * rows + row];
        Py_ssize_t pieces = 0;
        for (Py_ssize_t k = 1; k <= modes; k++)
            if (k == modes || rate[k] < rate[k - 1]) ends[pieces++] = k;
        double largest = 1.0; /* lags in series have large ones */
        for (Py_ssize_t k = 0; k < modes; k++) largest = fabs(amplitude[k]) > largest ? fabs(amplitude[k]) : largest;
        const double until = died_out + log(largest);
        for (Py_ssize_t begin = 0; begin < count; begin += TIMES) {
            const Py_ssize_t here = count - begin < TIMES ? count - begin : TIMES;
            Doubles at[2] = {{0}, {0}}, sum[2] = {{0}, {0}};
            double earliest = INFINITY;
            for (int j = 0; j < TIMES; j++) {
                at[j / WIDE][j % WIDE] = j < here ? t[begin + j] : INFINITY;
                earliest = j < here && t[begin + j] < earliest ? t[begin + j] : earliest;
            }
            for (Py_ssize_t piece = 0, k = 0; piece < pieces; k = ends[piece++])
                for (; k < ends[piece] && !(rate[k] * earliest >= until); k++)
                    for (int half = 0; half < 2; half++) add_exponential(&sum[half], amplitude[k], rate[k], &at[half]);
            for (Py_ssize_t j = 0; j < here; j++) out[begin + j] = sum[j / WIDE][j % WIDE];
        }
    }
}

/* One row: `amplitude` and `rate` of modes that ascend, padded to whole registers with amplitudes of 0; the trace's
 * `time` (samples) and `value`; `wanted` (count) in the order in which `order` has them rising. A piece whose ends are
 * at one time lasts `jump` [s]. `room` holds 4 arrays and a register more. */
WIDER static void drive_row(Py_ssize_t wide, const Doubles *amplitude, const Doubles *rate, Py_ssize_t samples,
                            const double *time, const double *value, double start, Py_ssize_t count,
                            const double *wanted, const int64_t *order, double gone, double even, double jump,
                            Doubles *room, double *out) {
    Doubles *state = room, *slowness = room + wide, *kept = room + 2 * wide, *steady = room + 3 * wide;
    double length = -1.0, all = 0.0; /* of the piece whose `kept` stand there; what faster modes add to a slope */
    for (Py_ssize_t k = 0; k < wide; k++) {
        state[k] = (Doubles){0} + (value[0] - start);
        slowness[k] = 1.0 / rate[k];
    }
    steady[wide] = (Doubles){0};
    for (Py_ssize_t k = wide - 1; k >= 0; k--) {
        for (int j = 0; j < WIDE; j++) all += amplitude[k][j] * slowness[k][j];
        steady[k] = (Doubles){0} + all;
    }
    Py_ssize_t next = 0;
    for (; next < count && !(wanted[order[next]] > time[0]); next++) out[order[next]] = start;
    for (Py_ssize_t i = 0; i < samples; i++) {
        const int last = i == samples - 1;
        const double given = last ? 1.0 : time[i + 1] - time[i], piece = given > jump ? given : jump;
        const double slope = last ? 0.0 : (value[i + 1] - value[i]) / piece;
        for (; next < count && (last || !(wanted[order[next]] > time[i + 1])); next++) {
            const double since = wanted[order[next]] - time[i];
            Doubles sum = {0};
            Py_ssize_t k = 0;
            for (; k < wide && !(rate[k][0] * since >= gone); k++) {
                Doubles change;
                forget(&rate[k], since, &change);
                sum += amplitude[k] * (state[k] + change * (state[k] - slope * slowness[k]));
            }
            double total = value[i] + slope * (since + steady[k][0]);
            for (int j = 0; j < WIDE; j++) total += sum[j];
            out[order[next]] = total;
        }
        if (next == count) return;
        const int anew = !(fabs(piece - length) <= even * length);
        for (Py_ssize_t k = 0; k < wide; k++) {
            if (rate[k][0] * piece >= gone) {
                state[k] = slope * slowness[k];
                continue;
            }
            if (anew) forget(&rate[k], piece, &kept[k]);
            state[k] += kept[k] * (state[k] - slope * slowness[k]);
        }
        length = anew ? piece : length;
    }
}

/* The buffers of some arrays, the last of which is written to: how many are held, and whether all have items of that
 * size. */
static int hold(int arrays, PyObject **given, Py_buffer *views, const Py_ssize_t *wide, int *fit) {
    for (int held = 0; held < arrays; held++) {
        const int flags = PyBUF_C_CONTIGUOUS | (held == arrays - 1 ? PyBUF_WRITABLE : 0);
        if (PyObject_GetBuffer(given[held], &views[held], flags) < 0) return held;
        *fit = *fit && views[held].itemsize == wide[held];
    }
    return arrays;
}

static PyObject *done(int held, Py_buffer *views, int right) {
    while (held > 0) PyBuffer_Release(&views[--held]);
    if (right) return Py_NewRef(Py_None);
    if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "arrays that do not fit one another");
    return NULL;
}

/* add_up(count, modes, places, times, rates, amplitudes, died_out, out), see `run`. */
static PyObject *add_up(PyObject *module, PyObject *args) {
    (void)module;
    enum { PLACES, TIMES_AT, RATES, AMPLITUDES, OUT, ARRAYS };
    static const Py_ssize_t wide[ARRAYS] = {sizeof(int64_t), sizeof(double), sizeof(double), sizeof(double),
                                            sizeof(double)};
    PyObject *given[ARRAYS];
    Py_buffer views[ARRAYS];
    Py_ssize_t count, modes;
    double died_out;
    int fit = 1;
    if (!PyArg_ParseTuple(args, "nnOOOOdO", &count, &modes, &given[PLACES], &given[TIMES_AT], &given[RATES],
                          &given[AMPLITUDES], &died_out, &given[OUT]))
        return NULL;
    const int held = hold(ARRAYS, given, views, wide, &fit);
    if (held < ARRAYS) return done(held, views, 0);
    const Py_ssize_t rows = views[PLACES].len / (3 * (Py_ssize_t)sizeof(int64_t));
    fit = fit && count >= 0 && modes >= 0 && views[OUT].len == rows * count * (Py_ssize_t)sizeof(double);
    const int64_t *places = views[PLACES].buf;
    for (Py_ssize_t i = 0; fit && i < 3 * rows; i++) {
        const Py_ssize_t of = TIMES_AT + i / rows, size = views[of].len / (Py_ssize_t)sizeof(double);
        fit = places[i] >= 0 && places[i] <= size - (of == TIMES_AT ? count : modes);
    }
    if (!fit) return done(held, views, 0);
    Py_ssize_t *room = malloc((size_t)(modes > 0 ? modes : 1) * sizeof(Py_ssize_t));
    if (room == NULL) {
        PyErr_NoMemory();
        return done(held, views, 0);
    }
    Py_BEGIN_ALLOW_THREADS;
    run(rows, count, modes, places, views[TIMES_AT].buf, views[RATES].buf, views[AMPLITUDES].buf, died_out, room,
        views[OUT].buf);
    Py_END_ALLOW_THREADS;
    free(room);
    return done(held, views, 1);
}

/* drive(modes, amplitudes, rates, time, values, starts, wanted, order, gone, even, jump, out): rows (rows, modes), and
 * so on, see `drive_row`. */
static PyObject *drive(PyObject *module, PyObject *args) {
    (void)module;
    enum { AMPLITUDES, RATES, TIME, VALUES, STARTS, WANTED, ORDER, OUT, ARRAYS };
    static const Py_ssize_t wide[ARRAYS] = {sizeof(double), sizeof(double), sizeof(double),  sizeof(double),
                                            sizeof(double), sizeof(double), sizeof(int64_t), sizeof(double)};
    PyObject *given[ARRAYS];
    Py_buffer views[ARRAYS];
    Py_ssize_t modes;
    double gone, even, jump;
    int fit = 1;
    if (!PyArg_ParseTuple(args, "nOOOOOOOdddO", &modes, &given[AMPLITUDES], &given[RATES], &given[TIME],
                          &given[VALUES], &given[STARTS], &given[WANTED], &given[ORDER], &gone, &even, &jump,
                          &given[OUT]))
        return NULL;
    const int held = hold(ARRAYS, given, views, wide, &fit);
    if (held < ARRAYS) return done(held, views, 0);
    const Py_ssize_t size = sizeof(double), rows = views[STARTS].len / size, samples = views[TIME].len / size;
    const Py_ssize_t count = rows > 0 ? views[OUT].len / (rows * size) : 0;
    fit = fit && rows > 0 && samples > 0 && modes > 0 && views[OUT].len == rows * count * size;
    fit = fit && views[AMPLITUDES].len == rows * modes * size && views[RATES].len == rows * modes * size;
    fit = fit && views[VALUES].len == rows * samples * size && views[WANTED].len == rows * count * size;
    fit = fit && views[ORDER].len == views[WANTED].len;
    const int64_t *order = views[ORDER].buf;
    for (Py_ssize_t i = 0; fit && i < rows * count; i++) fit = order[i] >= 0 && order[i] < count;
    if (!fit) return done(held, views, 0);
    const Py_ssize_t registers = (modes + WIDE - 1) / WIDE;
    void *memory = malloc((size_t)(6 * registers + 2) * sizeof(Doubles));
    if (memory == NULL) {
        PyErr_NoMemory();
        return done(held, views, 0);
    }
    Doubles *room = (Doubles *)(((uintptr_t)memory + sizeof(Doubles) - 1) / sizeof(Doubles) * sizeof(Doubles));
    Doubles *amplitude = room + 4 * registers + 1, *rate = amplitude + registers;
    const double *amplitudes = views[AMPLITUDES].buf, *rates = views[RATES].buf;
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t row = 0; row < rows; row++) {
        for (Py_ssize_t k = 0; k < registers * WIDE; k++) {
            const Py_ssize_t from = row * modes + (k < modes ? k : modes - 1);
            amplitude[k / WIDE][k % WIDE] = k < modes ? amplitudes[from] : 0.0;
            rate[k / WIDE][k % WIDE] = rates[from];
        }
        drive_row(registers, amplitude, rate, samples, views[TIME].buf, (double *)views[VALUES].buf + row * samples,
                  ((double *)views[STARTS].buf)[row], count, (double *)views[WANTED].buf + row * count,
                  order + row * count, gone, even, jump, room, (double *)views[OUT].buf + row * count);
    }
    Py_END_ALLOW_THREADS;
    free(memory);
    return done(held, views, 1);
}

static PyMethodDef methods[] = {{"add_up", add_up, METH_VARARGS, "Sums of exponentials."},
                                {"drive", drive, METH_VARARGS, "Modes that a trace drives."},
                                {NULL, NULL, 0, NULL}};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef sums = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_sums", .m_doc = SOURCE, .m_size = 0,
    .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__sums(void) { return PyModuleDef_Init(&sums); }
