/* Sums of exponentials compiled: what `exponentials.plain` does, leaving out what has died out by each few times.
 *
 * exp is a polynomial about the nearest power of two, off by less than two units of the last place, without calls or
 * branches: a processor takes several times at once, and every one gives the same numbers (no contraction).
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

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

/* sum += amplitude exp(-rate t), for rate t that is not negative */
INLINE void add_exponential(Doubles *sum, double amplitude, double rate, const Doubles *t) {
    const Doubles least = (Doubles){0} + LEAST;
    const Doubles given = -rate * *t;
    const Integers told = ~(given <= least); /* what is no number stays none */
    const Doubles x = (Doubles)(((Integers)given & told) | ((Integers)least & ~told));
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
    *sum += amplitude * (((even * s + odd * r) + 1.0) * (Doubles)((((Integers)whole << 52) + (1023LL << 52)) & told));
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

/* add_up(count, modes, places, times, rates, amplitudes, died_out, out), see `run`. */
static PyObject *add_up(PyObject *module, PyObject *args) {
    (void)module;
    enum { PLACES, TIMES_AT, RATES, AMPLITUDES, OUT, ARRAYS };
    static const Py_ssize_t wide[ARRAYS] = {sizeof(int64_t), sizeof(double), sizeof(double), sizeof(double),
                                            sizeof(double)};
    PyObject *given[ARRAYS], *result = NULL;
    Py_buffer views[ARRAYS];
    Py_ssize_t count, modes;
    Py_ssize_t *room = NULL;
    double died_out;
    int held = 0;
    if (!PyArg_ParseTuple(args, "nnOOOOdO", &count, &modes, &given[PLACES], &given[TIMES_AT], &given[RATES],
                          &given[AMPLITUDES], &died_out, &given[OUT]))
        return NULL;
    for (; held < ARRAYS; held++)
        if (PyObject_GetBuffer(given[held], &views[held], PyBUF_C_CONTIGUOUS | (held == OUT ? PyBUF_WRITABLE : 0)) < 0)
            goto done;
    const Py_ssize_t rows = views[PLACES].len / (3 * (Py_ssize_t)sizeof(int64_t));
    int fits = count >= 0 && modes >= 0 && views[OUT].len == rows * count * (Py_ssize_t)sizeof(double);
    for (int i = 0; i < ARRAYS; i++) fits = fits && views[i].itemsize == wide[i];
    const int64_t *places = views[PLACES].buf;
    for (Py_ssize_t i = 0; fits && i < 3 * rows; i++) {
        const Py_ssize_t of = TIMES_AT + i / rows, size = views[of].len / (Py_ssize_t)sizeof(double);
        fits = places[i] >= 0 && places[i] <= size - (of == TIMES_AT ? count : modes);
    }
    if (!fits) {
        PyErr_SetString(PyExc_ValueError, "arrays that do not fit one another");
        goto done;
    }
    room = malloc((size_t)(modes > 0 ? modes : 1) * sizeof(Py_ssize_t));
    if (room == NULL) {
        PyErr_NoMemory();
        goto done;
    }
    Py_BEGIN_ALLOW_THREADS;
    run(rows, count, modes, places, views[TIMES_AT].buf, views[RATES].buf, views[AMPLITUDES].buf, died_out, room,
        views[OUT].buf);
    Py_END_ALLOW_THREADS;
    result = Py_NewRef(Py_None);
done:
    free(room);
    while (held > 0) PyBuffer_Release(&views[--held]);
    return result;
}

static PyMethodDef methods[] = {{"add_up", add_up, METH_VARARGS, "Sums of exponentials."}, {NULL, NULL, 0, NULL}};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef sums = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_sums", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__sums(void) { return PyModuleDef_Init(&sums); }
