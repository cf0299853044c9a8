/* Numbers out of the lines of a table: columns of doubles from text, as Python's float() reads them.
 *
 * A line is plain where it is ASCII without quotes, NUL and lone carriage returns and has its cells; only such lines
 * are read here, what else there is csv reads. No NumPy in here: buffers, one build for every Python from 3.11.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

#define SOURCE "c612628223589bf0" /* files/compiled.py */

enum { LONGEST_CELL = 64, EXACT_DIGITS = 15, EXACT_POWER = 22 };
enum { MORE = 0, OTHER = 1, QUOTED = 2 };

static const double power_of_ten[EXACT_POWER + 1] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                     1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                                     1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/* A decimal number that fills a cell; 0 where it is none, or not finite, and `value` is untouched. */
static int number(const char *cell, Py_ssize_t size, double *value) {
    const char *at = cell, *end = cell + size;
    int negative = 0, digits = 0, counted = 0, exponent = 0;
    unsigned long long mantissa = 0;
    if (at < end && (*at == '-' || *at == '+')) negative = *at++ == '-';
    for (; at < end && *at >= '0' && *at <= '9'; at++, digits++)
        if ((mantissa || *at != '0') && ++counted <= EXACT_DIGITS) mantissa = 10 * mantissa + (unsigned)(*at - '0');
    if (at < end && *at == '.')
        for (at++; at < end && *at >= '0' && *at <= '9'; at++, digits++, exponent--)
            if ((mantissa || *at != '0') && ++counted <= EXACT_DIGITS) mantissa = 10 * mantissa + (unsigned)(*at - '0');
    if (!digits) return 0;
    if (at < end && (*at == 'e' || *at == 'E')) {
        int below = 0, power = 0;
        if (++at < end && (*at == '-' || *at == '+')) below = *at++ == '-';
        if (at == end) return 0;
        for (; at < end && *at >= '0' && *at <= '9'; at++)
            if (power < 10000) power = 10 * power + (*at - '0');
        exponent += below ? -power : power;
    }
    if (at != end) return 0;
    if (counted <= EXACT_DIGITS && exponent >= -EXACT_POWER && exponent <= EXACT_POWER) {
        /* both are exact, so that the one rounding is that of the quotient or product (Clinger 1990) */
        const double whole = (double)mantissa;
        const double size_of = exponent < 0 ? whole / power_of_ten[-exponent] : whole * power_of_ten[exponent];
        *value = negative ? -size_of : size_of;
        return 1;
    }
    char text[LONGEST_CELL + 1];
    if (size > LONGEST_CELL) return 0;
    memcpy(text, cell, (size_t)size);
    text[size] = '\0';
    const double found = PyOS_string_to_double(text, NULL, NULL);
    if (PyErr_Occurred()) {
        PyErr_Clear();
        return 0;
    }
    if (!isfinite(found)) return 0;
    *value = found;
    return 1;
}

/* Size of the line at `at` without its end, and of its end; -1 where it is not whole. `kind` says whether it is plain. */
static Py_ssize_t line_size(const char *at, const char *end, Py_ssize_t *ending, Py_ssize_t *commas, int *kind) {
    const char *newline = memchr(at, '\n', (size_t)(end - at));
    if (newline == NULL) return -1;
    const Py_ssize_t size = newline - at - (newline > at && newline[-1] == '\r');
    unsigned char every = 0;
    Py_ssize_t count = 0;
    int quoted = 0, nothing = 0;
    for (Py_ssize_t i = 0; i < size; i++) {
        const char c = at[i];
        every |= (unsigned char)c;
        count += c == ',';
        quoted |= (c == '"') | (c == '\r');
        nothing |= c == '\0';
    }
    *ending = newline - at + 1 - size;
    *commas = count;
    *kind = quoted ? QUOTED : nothing || every > 127 ? OTHER : MORE;
    return size;
}

/* read(data, start, longest, width, places, out, strange) -> (rows, stop, kind)
 *
 * Reads plain lines of `width` cells from `start` on, as many as `out` (places, rows) has room for; `longest` is the
 * longest line. Of the columns at the `places`, which ascend, an empty cell is NaN, and what is neither that nor a
 * number marks the column as `strange` (places,). It stops before a line that is not plain, for the reason of `kind`.
 */
static PyObject *read_lines(PyObject *module, PyObject *args) {
    (void)module;
    Py_buffer data, places, out, strange;
    Py_ssize_t start, longest, width, rows = 0;
    if (!PyArg_ParseTuple(args, "y*nnny*w*w*", &data, &start, &longest, &width, &places, &out, &strange)) return NULL;
    const Py_ssize_t count = places.len / (Py_ssize_t)sizeof(long long);
    const Py_ssize_t room = count ? out.len / (Py_ssize_t)sizeof(double) / count : 0;
    const long long *place = places.buf;
    double *values = out.buf;
    char *odd = strange.buf;
    int kind = MORE, fits = strange.len == count && start >= 0 && start <= data.len && width > 1;
    for (Py_ssize_t k = 0; k < count; k++) fits = fits && place[k] >= 0 && place[k] < width && (!k || place[k] > place[k - 1]);
    const char *at = (const char *)data.buf + start, *end = (const char *)data.buf + data.len;
    while (fits && rows < room && at < end) {
        Py_ssize_t ending, commas;
        const Py_ssize_t size = line_size(at, end, &ending, &commas, &kind);
        if (size < 0 || size > longest) {
            kind = size > longest || end - at > longest ? QUOTED : MORE;
            break;
        }
        if (kind == MORE && commas != width - 1) kind = OTHER;
        if (kind != MORE) break;
        const char *cell = at, *last = at + size;
        for (Py_ssize_t k = 0, column = 0; k < count; k++, column++) {
            for (; column < place[k]; column++) cell = (const char *)memchr(cell, ',', (size_t)(last - cell)) + 1;
            const char *comma = memchr(cell, ',', (size_t)(last - cell));
            const char *stop = comma ? comma : last;
            double value = Py_NAN;
            if (stop > cell && !number(cell, stop - cell, &value)) odd[k] = 1;
            values[k * room + rows] = value;
            cell = stop + (comma != NULL);
        }
        at += size + ending;
        rows++;
    }
    const Py_ssize_t stop = at - (const char *)data.buf;
    PyBuffer_Release(&data);
    PyBuffer_Release(&places);
    PyBuffer_Release(&out);
    PyBuffer_Release(&strange);
    if (fits) return Py_BuildValue("nni", rows, stop, kind);
    PyErr_SetString(PyExc_ValueError, "arrays that do not fit one another");
    return NULL;
}

static PyMethodDef methods[] = {{"read", read_lines, METH_VARARGS, "Columns of numbers from plain lines."},
                                {NULL, NULL, 0, NULL}};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef table = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_cells", .m_doc = SOURCE, .m_size = 0,
    .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__cells(void) { return PyModuleDef_Init(&table); }
