/* Even BDF2 steps of chains of cells, many at a time: what `chains.Stepper.step` does where step and links stay.
 *
 * right = (2 x - x_before / 2) capacity, pull added to the last cell; then L D L' x = right, as LAPACK's dpttrs solves
 * it: the same numbers to the last bit. Runs lie beside one another, so that a processor takes several at a time.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdlib.h>

#define SOURCE "ecde9dfec646b9f4" /* files/compiled.py */

enum { ARRAYS = 8 };
enum { STATE, BEFORE, CAPACITY, DIAGONAL, OFF, PULL, WEIGHT, OUT };

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDER __attribute__((target_clones("avx2", "default")))
#else
#define WIDER
#endif

WIDER static void run(Py_ssize_t steps, Py_ssize_t cells, Py_ssize_t runs, Py_ssize_t seen, double *x, double *before,
                      const double *capacity, const double *d, const double *e, const double *pull,
                      const double *weight, double *out) {
    const Py_ssize_t last = cells - 1;
    for (Py_ssize_t step = 0; step < steps; step++, pull += runs, out += runs) {
        double *right = before; /* each cell's own is read before it is written */
        for (Py_ssize_t i = 0; i < cells; i++) {
            const Py_ssize_t at = i * runs;
            for (Py_ssize_t j = 0; j < runs; j++)
                right[at + j] = (2.0 * x[at + j] - 0.5 * right[at + j]) * capacity[at + j];
            if (i == last)
                for (Py_ssize_t j = 0; j < runs; j++) right[at + j] += pull[j];
            if (i > 0)
                for (Py_ssize_t j = 0; j < runs; j++) right[at + j] -= right[at - runs + j] * e[at - runs + j];
        }
        for (Py_ssize_t j = 0; j < runs; j++) right[last * runs + j] /= d[last * runs + j];
        for (Py_ssize_t i = last - 1; i >= 0; i--) {
            const Py_ssize_t at = i * runs;
            for (Py_ssize_t j = 0; j < runs; j++)
                right[at + j] = right[at + j] / d[at + j] - right[at + runs + j] * e[at + j];
        }
        before = x;
        x = right;
        for (Py_ssize_t j = 0; j < runs; j++) out[j] = 0.0;
        for (Py_ssize_t i = 0; i < seen; i++)
            for (Py_ssize_t j = 0; j < runs; j++) out[j] += weight[i] * x[i * runs + j];
    }
}

/* advance(steps, cells, runs, arrays): state, before, capacity, diagonal and off (cells, runs), of which off's last row
 * is not looked at, pull (steps, runs), weight (up to cells), and what comes out (steps, runs). State and before are
 * those after the last step then. */
static PyObject *advance(PyObject *module, PyObject *args) {
    (void)module;
    Py_ssize_t steps, cells, runs, held = 0;
    PyObject *given[ARRAYS], *result = NULL;
    Py_buffer views[ARRAYS];
    double *work = NULL;
    if (!PyArg_ParseTuple(args, "nnn(OOOOOOOO)", &steps, &cells, &runs, &given[0], &given[1], &given[2], &given[3],
                          &given[4], &given[5], &given[6], &given[7]))
        return NULL;
    if (steps < 0 || cells < 1 || runs < 1) {
        PyErr_SetString(PyExc_ValueError, "at least one cell and one run are expected");
        return NULL;
    }
    const Py_ssize_t nodes = cells * runs, seen = steps * runs;
    const Py_ssize_t sizes[ARRAYS] = {nodes, nodes, nodes, nodes, nodes, seen, -1, seen};
    for (; held < ARRAYS; held++) {
        const int flags = PyBUF_C_CONTIGUOUS | (held > BEFORE && held < OUT ? 0 : PyBUF_WRITABLE);
        if (PyObject_GetBuffer(given[held], &views[held], flags) < 0) goto done;
        const Py_ssize_t size = views[held].len / (Py_ssize_t)sizeof(double);
        if (views[held].itemsize != sizeof(double) || (held == WEIGHT ? size > cells : size != sizes[held])) {
            PyErr_Format(PyExc_ValueError, "array %zd is not of the size that the others ask for", held++);
            goto done;
        }
    }
    work = malloc(2 * (size_t)nodes * sizeof(double));
    if (work == NULL) {
        PyErr_NoMemory();
        goto done;
    }
    double *in[ARRAYS];
    for (Py_ssize_t i = 0; i < ARRAYS; i++) in[i] = views[i].buf;
    for (Py_ssize_t i = 0; i < nodes; i++) work[i] = in[STATE][i], work[nodes + i] = in[BEFORE][i];
    Py_BEGIN_ALLOW_THREADS;
    run(steps, cells, runs, views[WEIGHT].len / (Py_ssize_t)sizeof(double), work, work + nodes, in[CAPACITY],
        in[DIAGONAL], in[OFF], in[PULL], in[WEIGHT], in[OUT]);
    const double *x = steps % 2 ? work + nodes : work, *before = steps % 2 ? work : work + nodes; /* they change places */
    for (Py_ssize_t i = 0; i < nodes; i++) in[STATE][i] = x[i], in[BEFORE][i] = before[i];
    Py_END_ALLOW_THREADS;
    result = Py_NewRef(Py_None);
done:
    free(work);
    while (held > 0) PyBuffer_Release(&views[--held]);
    return result;
}

static PyMethodDef methods[] = {{"advance", advance, METH_VARARGS, "Even steps of chains of cells."},
                                {NULL, NULL, 0, NULL}};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_march", .m_doc = SOURCE, .m_size = 0,
    .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__march(void) { return PyModuleDef_Init(&definition); }
