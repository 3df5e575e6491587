/* The loops of a measurement update over the places of a belief and the channels of a strain, compiled.
 *
 * A belief that has converged has some 200 places of a few numbers each, where calls of numpy cost ten times what
 * they compute. Each function is the twin of one in numpy, which takes its place where this module was not built
 * (core/compiled.py); a test compares the two on random input.
 *
 * N places, of which the first P are states and the others anchors; F phalanges with C channels together; M nodes of
 * the map. Arrays are C-contiguous: f float32, d float64, n intp. Those that a function writes come last.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Whether a buffer has so many values; otherwise an exception is set. */
static bool has_size(const Py_buffer *buffer, const char *name, Py_ssize_t count, size_t size)
{
    if (buffer->len == count * (Py_ssize_t)size) return true;
    PyErr_Format(PyExc_ValueError, "%s: expected %zd values of %zu bytes, got %zd bytes", name, count, size,
                 buffer->len);
    return false;
}

static void release(Py_buffer *buffers, size_t count)
{
    for (size_t k = 0; k < count; k++) PyBuffer_Release(&buffers[k]);
}

#define COUNT(buffer, type) ((buffer).len / (Py_ssize_t)sizeof(type))
#define HAS(buffer, count, type) has_size(&a[buffer], #buffer, count, sizeof(type))

/* map_at(places d (d, N), origin d (d,), step d (d,), shape n (d,), table f (M, C); nodes n (N,), strain f (N, C)) */
static PyObject *map_at(PyObject *self, PyObject *args)
{
    enum { PLACES, ORIGIN, STEP, SHAPE, TABLE, NODES, STRAIN, ALL };
    Py_buffer a[ALL] = {{0}};
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*w*w*", &a[PLACES], &a[ORIGIN], &a[STEP], &a[SHAPE], &a[TABLE], &a[NODES],
                          &a[STRAIN]))
        return NULL;
    const Py_ssize_t axes = COUNT(a[SHAPE], intptr_t), places = COUNT(a[NODES], intptr_t);
    const double *place = a[PLACES].buf, *origin = a[ORIGIN].buf, *step = a[STEP].buf;
    const intptr_t *shape = a[SHAPE].buf;
    Py_ssize_t all = 1;
    for (Py_ssize_t axis = 0; axis < axes; axis++) all *= shape[axis];
    const Py_ssize_t channels = all > 0 ? COUNT(a[TABLE], float) / all : 0;
    const bool fits = HAS(PLACES, axes * places, double) && HAS(ORIGIN, axes, double) && HAS(STEP, axes, double) &&
                      HAS(TABLE, all * channels, float) && HAS(STRAIN, places * channels, float);
    for (Py_ssize_t n = 0; fits && n < places; n++) {
        intptr_t node = 0;
        for (Py_ssize_t axis = 0; axis < axes; axis++) {
            const double along = rint((place[axis * places + n] - origin[axis]) / step[axis]);
            const double last = (double)(shape[axis] - 1);
            node = node * shape[axis] + (intptr_t)(along > 0.0 ? (along < last ? along : last) : 0.0);
        }
        ((intptr_t *)a[NODES].buf)[n] = node;
        memcpy((float *)a[STRAIN].buf + n * channels, (const float *)a[TABLE].buf + node * channels,
               (size_t)channels * sizeof(float));
    }
    release(a, ALL);
    if (!fits) return NULL;
    Py_RETURN_NONE;
}

/* noise(strain d (C,), present bool (C,), kept d (C,), step d (C,), variance d (C,): before it;
 *       largest square of no spike, bound and mean of squares, weight of the strain;
 *       variance d (C,), step d (C,): after it): whether there is a spike
 */
static PyObject *noise(PyObject *self, PyObject *args)
{
    enum { STRAIN, PRESENT, KEPT, STEP, VARIANCE, NEXT_VARIANCE, NEXT_STEP, ALL };
    Py_buffer a[ALL] = {{0}};
    double largest, bound, mean, gain;
    bool has_spike = false;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*ddddw*w*", &a[STRAIN], &a[PRESENT], &a[KEPT], &a[STEP], &a[VARIANCE],
                          &largest, &bound, &mean, &gain, &a[NEXT_VARIANCE], &a[NEXT_STEP]))
        return NULL;
    const Py_ssize_t channels = COUNT(a[STRAIN], double);
    const double *strain = a[STRAIN].buf, *kept = a[KEPT].buf, *step = a[STEP].buf, *variance = a[VARIANCE].buf;
    const bool fits = HAS(PRESENT, channels, char) && HAS(KEPT, channels, double) && HAS(STEP, channels, double) &&
                      HAS(VARIANCE, channels, double) && HAS(NEXT_VARIANCE, channels, double) &&
                      HAS(NEXT_STEP, channels, double);
    for (Py_ssize_t c = 0; fits && c < channels; c++) {
        const double off = strain[c] - (kept[c] + step[c]), square = off * off / (6.0 * variance[c]);
        const double change = ((square < bound ? square : bound) - mean) * gain;
        has_spike = has_spike || square > largest;
        ((double *)a[NEXT_VARIANCE].buf)[c] = variance[c] * (((const char *)a[PRESENT].buf)[c] ? 1.0 + change : 1.0);
        ((double *)a[NEXT_STEP].buf)[c] = strain[c] - kept[c];
    }
    release(a, ALL);
    return fits ? PyBool_FromLong(has_spike) : NULL;
}

/* The axes of a grid, and by how many cells it is shifted along each. */
typedef struct {
    Py_ssize_t axes, last; /* number of axes, and of the cells of a row, which is along the last one */
    const intptr_t *shape, *shift;
    const char *wraps;
} Grid;

/* First cell of the row that was where a row of cells is now, or -1: there was none. */
static Py_ssize_t row_before_shift(const Grid *grid, Py_ssize_t row)
{
    Py_ssize_t first = 0, apart = grid->last;
    for (Py_ssize_t axis = grid->axes - 2; axis >= 0; axis--) {
        const Py_ssize_t size = grid->shape[axis];
        Py_ssize_t cell = row % size - grid->shift[axis];
        if (grid->wraps[axis]) cell = (cell % size + size) % size;
        if (cell < 0 || cell >= size) return -1;
        first += cell * apart;
        row /= size;
        apart *= size;
    }
    return first;
}

/* Belief and numbers of a row of cells after a shift along it. */
static void shift_row(const Grid *grid, const double *restrict belief, const intptr_t *restrict numbers,
                      double *restrict moved, intptr_t *restrict moved_numbers)
{
    const Py_ssize_t size = grid->last, shift = grid->shift[grid->axes - 1];
    const Py_ssize_t by = grid->wraps[grid->axes - 1] ? (shift % size + size) % size : shift;
    const Py_ssize_t begin = by > 0 ? by : 0, end = by > 0 ? size : size + by;
    for (Py_ssize_t n = begin; n < end; n++) {
        moved[n] = belief[n - by];
        moved_numbers[n] = numbers[n - by];
    }
    for (Py_ssize_t n = 0; grid->wraps[grid->axes - 1] && n < by; n++) {
        moved[n] = belief[n - by + size];
        moved_numbers[n] = numbers[n - by + size];
    }
}

/* Spreads cells by a variance along an axis of so many, which are so far apart: each takes in of its neighbours. */
static void spread_cells(double *restrict cells, Py_ssize_t all, Py_ssize_t count, Py_ssize_t apart, bool wraps,
                         double variance, double *restrict room)
{
    const double kept = 1.0 - variance, beside = 0.5 * variance;
    double *before = room, *first = room + apart, *none = room + 2 * apart; /* of a row of cells along other axes */
    const size_t size = (size_t)apart * sizeof(double);
    memset(none, 0, size);
    for (double *part = cells; part < cells + all; part += count * apart) {
        memcpy(first, part, size);
        memcpy(before, wraps ? part + (count - 1) * apart : none, size);
        for (Py_ssize_t n = 0; n < count; n++) {
            double *row = part + n * apart;
            const double *after = n + 1 < count ? row + apart : wraps ? first : none;
            for (Py_ssize_t k = 0; k < apart; k++) {
                const double here = row[k];
                row[k] = kept * here + beside * before[k] + beside * after[k];
                before[k] = here;
            }
        }
    }
}

/* move_cells(belief d (N,), numbers n (N,): of the cells of a grid; shape n (d,), shift n (d,), variance d (d,),
 *            wraps bool (d,): of its axes; belief d (N,) after it, with a sum of one, numbers n (N,))
 *
 * Returns the sum of the belief that stayed on the grid.
 */
static PyObject *move_cells(PyObject *self, PyObject *args)
{
    enum { BELIEF, NUMBERS, SHAPE, SHIFT, VARIANCE, WRAPS, MOVED, MOVED_NUMBERS, ALL };
    Py_buffer a[ALL] = {{0}};
    double total = 0.0;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*w*w*", &a[BELIEF], &a[NUMBERS], &a[SHAPE], &a[SHIFT], &a[VARIANCE],
                          &a[WRAPS], &a[MOVED], &a[MOVED_NUMBERS]))
        return NULL;
    Grid grid = {COUNT(a[SHAPE], intptr_t), 1, a[SHAPE].buf, a[SHIFT].buf, a[WRAPS].buf};
    Py_ssize_t count = 1;
    for (Py_ssize_t axis = 0; axis < grid.axes; axis++) count *= grid.last = grid.shape[axis];
    const double *belief = a[BELIEF].buf, *variance = a[VARIANCE].buf;
    const intptr_t *numbers = a[NUMBERS].buf;
    double *moved = a[MOVED].buf, *room = PyMem_Malloc((size_t)(3 * count) * sizeof(double));
    intptr_t *moved_numbers = a[MOVED_NUMBERS].buf;
    if (!room) PyErr_NoMemory();
    if (grid.axes < 1) PyErr_SetString(PyExc_ValueError, "SHAPE: expected at least one axis, got none");
    const bool fits = room && grid.axes > 0 && HAS(BELIEF, count, double) && HAS(NUMBERS, count, intptr_t) &&
                      HAS(SHIFT, grid.axes, intptr_t) && HAS(VARIANCE, grid.axes, double) &&
                      HAS(WRAPS, grid.axes, char) && HAS(MOVED, count, double) &&
                      HAS(MOVED_NUMBERS, count, intptr_t);
    for (Py_ssize_t n = 0; fits && n < count; n++) {
        moved[n] = 0.0;
        moved_numbers[n] = -1;
    }
    for (Py_ssize_t begin = 0; fits && begin < count; begin += grid.last) {
        const Py_ssize_t before = row_before_shift(&grid, begin / grid.last);
        if (before >= 0) shift_row(&grid, belief + before, numbers + before, moved + begin, moved_numbers + begin);
    }
    for (Py_ssize_t axis = 0, apart = fits ? count : 0; apart && axis < grid.axes; axis++) {
        apart /= grid.shape[axis];
        if (variance[axis] > 0.0)
            spread_cells(moved, count, grid.shape[axis], apart, grid.wraps[axis], variance[axis], room);
    }
    for (Py_ssize_t n = 0; fits && n < count; n++) total += moved[n];
    for (Py_ssize_t n = 0; fits && n < count; n++)
        moved[n] = total > 0.0 ? moved[n] / total : 1.0 / (double)count;
    PyMem_Free(room);
    release(a, ALL);
    return fits ? PyFloat_FromDouble(total) : NULL;
}

/* living(cells d (N,), kept d (N,): of the cells, what was not taken in; number_of n (N,): that of each before, or -1;
 *        centres d (d, N), offset d (d,), the least weight that counts;
 *        alive n (N,), states d (d, N), weights d (N,), ancestors n (N,), continued d (N,), next number_of n (N,)): P,
 *        the number of living cells; the outputs begin with theirs, P or (d, P), but for the last
 */
static PyObject *living(PyObject *self, PyObject *args)
{
    enum { CELLS, KEPT, NUMBER_OF, CENTRES, OFFSET, ALIVE, STATES, WEIGHTS, ANCESTORS, CONTINUED, NEXT, ALL };
    Py_buffer a[ALL] = {{0}};
    Py_ssize_t found = 0;
    double least, total = 0.0;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*dw*w*w*w*w*w*", &a[CELLS], &a[KEPT], &a[NUMBER_OF], &a[CENTRES], &a[OFFSET],
                          &least, &a[ALIVE], &a[STATES], &a[WEIGHTS], &a[ANCESTORS], &a[CONTINUED], &a[NEXT]))
        return NULL;
    const Py_ssize_t count = COUNT(a[CELLS], double), axes = COUNT(a[OFFSET], double);
    const double *cells = a[CELLS].buf, *kept = a[KEPT].buf, *centres = a[CENTRES].buf, *offset = a[OFFSET].buf;
    const intptr_t *number_of = a[NUMBER_OF].buf;
    intptr_t *alive = a[ALIVE].buf, *ancestors = a[ANCESTORS].buf, *next = a[NEXT].buf;
    double *states = a[STATES].buf, *weights = a[WEIGHTS].buf, *continued = a[CONTINUED].buf;
    const bool fits = HAS(KEPT, count, double) && HAS(NUMBER_OF, count, intptr_t) &&
                      HAS(CENTRES, axes * count, double) && HAS(ALIVE, count, intptr_t) &&
                      HAS(STATES, axes * count, double) && HAS(WEIGHTS, count, double) &&
                      HAS(ANCESTORS, count, intptr_t) && HAS(CONTINUED, count, double) && HAS(NEXT, count, intptr_t);
    if (fits) memset(next, -1, (size_t)count * sizeof(intptr_t));
    for (Py_ssize_t begin = 0, end; fits && begin < count; begin = end) {
        enum { TOGETHER = 32 }; /* most cells have no weight: of so many it is found out at once */
        int any = 0;
        end = begin + TOGETHER < count ? begin + TOGETHER : count;
        for (Py_ssize_t n = begin; n < end; n++) any |= cells[n] > least;
        for (Py_ssize_t n = begin; any && n < end; n++) {
            if (!(cells[n] > least)) continue;
            alive[found] = n;
            weights[found] = cells[n];
            ancestors[found] = number_of[n] < 0 ? 0 : number_of[n];
            continued[found] = number_of[n] < 0 ? 0.0 : kept[n] / cells[n];
            total += cells[n];
            next[n] = found++;
        }
    }
    for (Py_ssize_t k = 0; k < found; k++) weights[k] /= total;
    for (Py_ssize_t axis = 0; axis < axes; axis++)
        for (Py_ssize_t k = 0; k < found; k++)
            states[axis * found + k] = centres[axis * count + alive[k]] + offset[axis];
    release(a, ALL);
    return fits ? PyLong_FromSsize_t(found) : NULL;
}

/* Adds to a sum (C,) four rows (4, C) with weights (4,). */
static void add_rows(const float *restrict rows, const double *restrict weights, Py_ssize_t channels,
                     float *restrict sum)
{
    const float one = (float)weights[0], two = (float)weights[1], three = (float)weights[2], four = (float)weights[3];
    const float *second = rows + channels, *third = second + channels, *fourth = third + channels;
    for (Py_ssize_t c = 0; c < channels; c++)
        sum[c] += (one * rows[c] + two * second[c]) + (three * third[c] + four * fourth[c]);
}

/* Mean of rows (P, C) with weights (P,). */
static void mean_row(const float *restrict rows, Py_ssize_t channels, const double *restrict weights, Py_ssize_t count,
                     float *restrict mean)
{
    Py_ssize_t n = 0;
    memset(mean, 0, (size_t)channels * sizeof(float));
    for (; channels == 1 && n < count; n++) mean[0] += (float)weights[n] * rows[n]; /* a loop of vectors */
    for (; n + 4 <= count; n += 4) add_rows(rows + n * channels, weights + n, channels, mean);
    for (; n < count; n++)
        for (Py_ssize_t c = 0; c < channels; c++) mean[c] += (float)weights[n] * rows[n * channels + c];
}

/* Of what is known before (C,) of a trajectory, and of the mean (C,), to which it came to a share from anywhere. */
static void blend(const float *restrict before, const float *restrict mean, float share, Py_ssize_t channels,
                  float *restrict found)
{
    for (Py_ssize_t c = 0; c < channels; c++) found[c] = (1.0f - share) * before[c] + share * mean[c];
}

/* follow(K, values f (K, Q + R, C), ancestors n (P,), continued d (P,), placed d (R,), weights d (Q,);
 *        found f (K, P + R, C))
 */
static PyObject *follow(PyObject *self, PyObject *args)
{
    enum { VALUES, ANCESTORS, CONTINUED, PLACED, WEIGHTS, FOUND, ALL };
    Py_buffer a[ALL] = {{0}};
    Py_ssize_t kinds;
    float *mean = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "ny*y*y*y*y*w*", &kinds, &a[VALUES], &a[ANCESTORS], &a[CONTINUED], &a[PLACED],
                          &a[WEIGHTS], &a[FOUND]))
        return NULL;
    const Py_ssize_t states = COUNT(a[ANCESTORS], intptr_t), anchors = COUNT(a[PLACED], double);
    const Py_ssize_t states_before = COUNT(a[WEIGHTS], double);
    const Py_ssize_t before = states_before + anchors, after = states + anchors;
    const Py_ssize_t channels = kinds * after > 0 ? COUNT(a[FOUND], float) / (kinds * after) : 0;
    const intptr_t *ancestors = a[ANCESTORS].buf;
    const double *continued = a[CONTINUED].buf, *placed = a[PLACED].buf;
    if (!(HAS(CONTINUED, states, double) && HAS(FOUND, kinds * after * channels, float))) goto end;
    if (after && !HAS(VALUES, kinds * before * channels, float)) goto end;
    for (Py_ssize_t m = 0; m < states; m++) {
        if (ancestors[m] >= 0 && ancestors[m] < states_before) continue;
        PyErr_Format(PyExc_ValueError, "ancestors: expected numbers below %zd, got %zd", states_before, ancestors[m]);
        goto end;
    }
    mean = PyMem_Malloc((size_t)channels * sizeof(float));
    if (!mean) {
        PyErr_NoMemory();
        goto end;
    }
    for (Py_ssize_t k = 0; after && k < kinds; k++) {
        const float *values = (const float *)a[VALUES].buf + k * before * channels;
        float *found = (float *)a[FOUND].buf + k * after * channels;
        mean_row(values, channels, a[WEIGHTS].buf, states_before, mean);
        for (Py_ssize_t m = 0, next; m < states; m = next) {
            const float *own = values + ancestors[m] * channels;
            next = m + 1;
            if (continued[m] == 1.0) { /* as of most: neighbours come from neighbours, and are copied together */
                while (next < states && continued[next] == 1.0 && ancestors[next] == ancestors[m] + (next - m)) next++;
                memcpy(found + m * channels, own, (size_t)((next - m) * channels) * sizeof(float));
            } else {
                blend(own, mean, (float)(1.0 - continued[m]), channels, found + m * channels);
            }
        }
        const float *of_anchors = values + states_before * channels;
        float *found_of = found + states * channels;
        for (Py_ssize_t r = 0; channels == 1 && r < anchors; r++) /* the same, but vectors */
            found_of[r] = (1.0f - (float)placed[r]) * of_anchors[r] + (float)placed[r] * mean[0];
        for (Py_ssize_t r = 0; channels > 1 && r < anchors; r++)
            blend(of_anchors + r * channels, mean, (float)placed[r], channels, found_of + r * channels);
    }
end:
    PyMem_Free(mean);
    release(a, ALL);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* anchors(origin d (d, R), displacement d (d,), lower d (d,), extent d (d,), ends bool (d,);
 *         shift d (d,), beyond bool (d, R): before, and after it; states d (d, R), left bool (R,))
 */
static PyObject *anchors(PyObject *self, PyObject *args)
{
    enum { ORIGIN, DISPLACEMENT, LOWER, EXTENT, ENDS, SHIFT, BEYOND, STATES, LEFT, ALL };
    Py_buffer a[ALL] = {{0}};
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*w*w*w*w*", &a[ORIGIN], &a[DISPLACEMENT], &a[LOWER], &a[EXTENT], &a[ENDS],
                          &a[SHIFT], &a[BEYOND], &a[STATES], &a[LEFT]))
        return NULL;
    const Py_ssize_t axes = COUNT(a[SHIFT], double), count = COUNT(a[LEFT], char);
    const double *displacement = a[DISPLACEMENT].buf, *lower = a[LOWER].buf, *extents = a[EXTENT].buf;
    double *shifts = a[SHIFT].buf;
    char *left = a[LEFT].buf;
    const bool fits = HAS(ORIGIN, axes * count, double) && HAS(DISPLACEMENT, axes, double) &&
                      HAS(LOWER, axes, double) && HAS(EXTENT, axes, double) && HAS(ENDS, axes, char) &&
                      HAS(BEYOND, axes * count, char) && HAS(STATES, axes * count, double);
    if (fits) memset(left, 0, (size_t)count);
    for (Py_ssize_t axis = 0; fits && axis < axes; axis++) {
        const double *origin = (const double *)a[ORIGIN].buf + axis * count, extent = extents[axis];
        const double moved = shifts[axis] + displacement[axis], rest = fmod(moved, extent);
        const double shift = rest < 0.0 ? rest + extent : rest, turns = rint((moved - shift) / extent);
        const bool has_ends = ((const char *)a[ENDS].buf)[axis];
        double *states = (double *)a[STATES].buf + axis * count;
        char *beyond = (char *)a[BEYOND].buf + axis * count;
        for (Py_ssize_t r = 0; r < count; r++) {
            const double place = origin[r] + shift;
            const bool is_beyond = place >= extent, has_turned = beyond[r] != turns + is_beyond;
            states[r] = lower[axis] + (place - (is_beyond ? extent : 0.0));
            beyond[r] = is_beyond;
            left[r] |= has_turned && has_ends;
        }
        shifts[axis] = shift;
    }
    release(a, ALL);
    if (!fits) return NULL;
    Py_RETURN_NONE;
}

/* far_from(states d (d, R), place d (d,), levers d (d,), distance, values d (R,);
 *          found d (R,)): the values of the states that are farther from the place, and -inf of the others
 */
static PyObject *far_from(PyObject *self, PyObject *args)
{
    enum { STATES, PLACE, LEVERS, VALUES, FOUND, ALL };
    Py_buffer a[ALL] = {{0}};
    double distance;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*dy*w*", &a[STATES], &a[PLACE], &a[LEVERS], &distance, &a[VALUES], &a[FOUND]))
        return NULL;
    const Py_ssize_t axes = COUNT(a[PLACE], double), count = COUNT(a[FOUND], double);
    const double *states = a[STATES].buf, *place = a[PLACE].buf, *levers = a[LEVERS].buf, *values = a[VALUES].buf;
    double *found = a[FOUND].buf;
    const bool fits = HAS(STATES, axes * count, double) && HAS(LEVERS, axes, double) && HAS(VALUES, count, double);
    for (Py_ssize_t r = 0; fits && r < count; r++) {
        double squared = 0.0;
        for (Py_ssize_t axis = 0; axis < axes; axis++) {
            const double away = (states[axis * count + r] - place[axis]) * levers[axis];
            squared += away * away;
        }
        found[r] = sqrt(squared) > distance ? values[r] : -INFINITY;
    }
    release(a, ALL);
    if (!fits) return NULL;
    Py_RETURN_NONE;
}

/* What of the map at places (N, C) its trend does not predict, and level and rate after it. */
static void drift_rows(Py_ssize_t size, Py_ssize_t channels, float step, float turn, const float *restrict gain,
                       const float *restrict strain, const float *restrict level, const float *restrict rate,
                       float *restrict left, float *restrict next_level, float *restrict next_rate)
{
    for (Py_ssize_t row = 0; row < size; row += channels) {
        for (Py_ssize_t c = 0; c < channels; c++) {
            const float predicted = step * rate[row + c] + level[row + c], new = strain[row + c] - predicted;
            left[row + c] = new;
            next_level[row + c] = new * gain[c] + predicted;
            next_rate[row + c] = new * turn + rate[row + c];
        }
    }
}

static const double LARGEST_GAIN = 1.0 - 1e-9; /* as in core/likelihood/drift.py */

/* drift(measurements, level, rate, prior, whitened, exponent, all d (C,); memory, variance, largest energy, travel;
 *       map_strain f (N, C), of_map f (2, N, C);
 *       strain_left, level_variance, next measurements, level, rate, all d (C,); left f (N, C), following f (2, N, C))
 */
static PyObject *drift(PyObject *self, PyObject *args)
{
    enum { MEASUREMENTS, LEVEL, RATE, PRIOR, WHITENED, EXPONENT, MAP_STRAIN, OF_MAP, STRAIN_LEFT, LEVEL_VARIANCE,
           NEXT_MEASUREMENTS, NEXT_LEVEL, NEXT_RATE, LEFT, FOLLOWING, ALL };
    Py_buffer a[ALL] = {{0}};
    double memory, variance, largest_energy, travel, energy = 0.0, weight = 1.0, rate_gain = 0.0;
    float *gain = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*ddddy*y*w*w*w*w*w*w*w*", &a[MEASUREMENTS], &a[LEVEL], &a[RATE], &a[PRIOR],
                          &a[WHITENED], &a[EXPONENT], &memory, &variance, &largest_energy, &travel, &a[MAP_STRAIN],
                          &a[OF_MAP], &a[STRAIN_LEFT], &a[LEVEL_VARIANCE], &a[NEXT_MEASUREMENTS], &a[NEXT_LEVEL],
                          &a[NEXT_RATE], &a[LEFT], &a[FOLLOWING]))
        return NULL;
    const Py_ssize_t channels = COUNT(a[PRIOR], double), size = COUNT(a[MAP_STRAIN], float);
    const double *measurements = a[MEASUREMENTS].buf, *level = a[LEVEL].buf, *rate = a[RATE].buf, *prior = a[PRIOR].buf;
    const double *whitened = a[WHITENED].buf, *exponent = a[EXPONENT].buf;
    double *strain_left = a[STRAIN_LEFT].buf, *level_variance = a[LEVEL_VARIANCE].buf;
    double *next_measurements = a[NEXT_MEASUREMENTS].buf;
    double *next_level = a[NEXT_LEVEL].buf, *next_rate = a[NEXT_RATE].buf;
    for (int k = 0; k < ALL; k++) {
        const bool of_places = k == MAP_STRAIN || k == OF_MAP || k == LEFT || k == FOLLOWING;
        const Py_ssize_t values = k == OF_MAP || k == FOLLOWING ? 2 * size : of_places ? size : channels;
        if (!has_size(&a[k], "an array of drift", values, of_places ? sizeof(float) : sizeof(double))) goto end;
    }
    gain = PyMem_Malloc((size_t)channels * sizeof(float));
    if (!gain) {
        PyErr_NoMemory();
        goto end;
    }
    bool is_known = false;
    travel = travel < memory ? travel : memory;
    for (Py_ssize_t c = 0; c < channels; c++) {
        strain_left[c] = whitened[c] - (level[c] + travel * rate[c]);
        energy += strain_left[c] * strain_left[c];
        is_known = is_known || measurements[c] + prior[c] != 0.0;
    }
    if (is_known) {
        weight = 1.0 / (1.0 + energy / largest_energy);
        rate_gain = weight * travel / (4.0 * memory * memory);
    }
    for (Py_ssize_t c = 0; c < channels; c++) {
        const double added = exponent[c] * weight, least = weight * travel / memory;
        double share = added / (measurements[c] + prior[c] + added);
        share = share > least ? share : least;
        share = share < LARGEST_GAIN ? share : LARGEST_GAIN;
        gain[c] = (float)share;
        next_measurements[c] = 0.5 * (1.0 + weight) * measurements[c] + added;
        next_level[c] = level[c] + travel * rate[c] + share * strain_left[c];
        next_rate[c] = rate[c] + rate_gain * strain_left[c];
        level_variance[c] = variance * share / (1.0 - share) / exponent[c];
    }
    const float *level_of_map = a[OF_MAP].buf;
    float *following = a[FOLLOWING].buf;
    drift_rows(size, channels, (float)travel, (float)rate_gain, gain, a[MAP_STRAIN].buf, level_of_map,
               level_of_map + size, a[LEFT].buf, following, following + size);
end:
    PyMem_Free(gain);
    release(a, ALL);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* Logarithm of a positive number that is finite, to 1.5e-7 of it. Unlike logf(), a loop of it is one of vectors.
 *
 * With f in [sqrt(1/2) - 1, sqrt(2) - 1]: log(1 + f) = f - f^2 / 2 + f^3 Q(f), with Q by least squares.
 */
static inline float fast_log(float x)
{
    int32_t bits, exponent;
    float mantissa;
    memcpy(&bits, &x, sizeof bits);
    exponent = (bits - 0x3f3504f3) >> 23; /* of a mantissa from sqrt(1/2) to sqrt(2) */
    bits -= (int32_t)((uint32_t)exponent << 23);
    memcpy(&mantissa, &bits, sizeof mantissa);
    const float f = mantissa - 1.0f;
    float q = 0.0850695372f;
    q = q * f - 0.141974717f;
    q = q * f + 0.149509788f;
    q = q * f - 0.165879488f;
    q = q * f + 0.199605972f;
    q = q * f - 0.250009686f;
    q = q * f + 0.333339721f;
    return (float)exponent * 0.693147182f + (f - 0.5f * f * f + f * f * f * q);
}

/* Components that are worked on together: in the loops over them, which are ones of vectors, most time is spent. */
enum { LANES = 64 };
typedef float Lanes[LANES];

/* Of signals (C,) the products with an upper triangle (C, C), of which that of a sheet has a block per phalanx. */
static void transformed(const Lanes *restrict signals, const float *restrict triangle, Py_ssize_t channels,
                        Lanes *restrict products)
{
    for (Py_ssize_t c = 0; c < channels; c++) {
        Lanes sum = {0};
        for (Py_ssize_t row = 0; row <= c; row++) {
            const float factor = triangle[row * channels + c];
            if (factor == 0.0f) continue;
            for (int k = 0; k < LANES; k++) sum[k] += factor * signals[row][k];
        }
        memcpy(products[c], sum, sizeof sum);
    }
}

/* Residuals of a phalanx's strain (count,) from signals (count,) at a mean gain, and their product with the signal. */
typedef struct {
    Lanes energy, product, squared;
} Residuals;

static void residuals(const float *restrict strain, const Lanes *restrict signals, Py_ssize_t count,
                      const float *restrict mean, Residuals *restrict of)
{
    memset(of, 0, sizeof *of);
    for (Py_ssize_t c = 0; c < count; c++) {
        for (int k = 0; k < LANES; k++) {
            const float signal = signals[c][k], left = strain[c] - signal;
            of->energy[k] += signal * signal;
            of->product[k] += strain[c] * signal;
            of->squared[k] += left * left;
        }
    }
    for (int k = 0; k < LANES; k++) { /* from the residual of a gain of one to that of the mean gain */
        const float more = 1.0f - mean[k], product = of->product[k] - of->energy[k];
        of->product[k] = product + more * of->energy[k];
        of->squared[k] += more * (2.0f * product + more * of->energy[k]);
    }
}

/* Log-densities of residuals, and their squared Mahalanobis lengths (core/likelihood/student_t.py). */
static void densities(const Residuals *restrict of, const float *restrict gain, const float *restrict variance,
                      float channels, float degrees, float *restrict length, float *restrict log_density)
{
    for (int k = 0; k < LANES; k++) {
        const float total = variance[k] + gain[k] * of->energy[k];
        const float left = of->squared[k] - gain[k] * (of->product[k] * of->product[k]) / total;
        const float across = (left > 0.0f ? left : 0.0f) / variance[k];
        const float tails = (degrees + channels) * fast_log(1.0f + across * (1.0f / degrees));
        length[k] = across;
        log_density[k] = -0.5f * (tails + (channels - 1.0f) * fast_log(variance[k]) + fast_log(total));
    }
}

/* What on_map is given, by the names there, and room for signals, and for the same whitened. */
typedef struct {
    Py_ssize_t phalanges, channels, places, states, nodes, others;
    const float *spread, *away, *other_spread, *of_map, *mean, *gain, *strain, *transform, *level;
    const intptr_t *counts, *starts, *node_of, *bounds;
    const char *used;
    float degrees, exponent;
    Lanes *signals, *whitened;
} Comparison;

/* Log-densities (F, N) of the first components, which have a prior at states, and the gain after the strain. */
static void first_components(const Comparison *of, float *restrict log_densities, float *restrict next_mean,
                             float *restrict next_gain)
{
    for (Py_ssize_t begin = 0; begin < of->places; begin += LANES) {
        const Py_ssize_t left = of->places - begin, lanes = left < LANES ? left : LANES;
        const intptr_t *node = of->node_of + begin;
        const float *of_map = of->of_map + begin * of->channels;
        for (Py_ssize_t k = 0; k < lanes; k++)
            for (Py_ssize_t c = 0; c < of->channels; c++) of->signals[c][k] = of_map[k * of->channels + c];
        if (of->transform) transformed(of->signals, of->transform, of->channels, of->whitened);
        for (Py_ssize_t f = 0; f < of->phalanges; f++) {
            const Py_ssize_t first = of->bounds[f], count = of->bounds[f + 1] - first, at = f * of->places + begin;
            const float *spread = of->spread + f * of->nodes, *log_prior = of->spread + of->phalanges * of->nodes;
            const float width = (float)count;
            const size_t size = (size_t)lanes * sizeof(float);
            Lanes mean = {0}, gain = {0}, variance, length, log_density;
            Residuals residual;
            memcpy(mean, of->mean + at, size);
            memcpy(gain, of->gain + at, size);
            for (int k = 0; k < LANES; k++) variance[k] = 1.0f; /* of lanes without a place, too */
            for (Py_ssize_t k = 0; k < lanes; k++) variance[k] = spread[node[k]] + of->level[f];
            residuals(of->strain + first, of->whitened + first, count, mean, &residual);
            densities(&residual, gain, variance, width, of->degrees, length, log_density);
            for (int k = 0; k < LANES; k++) {
                const float weight = of->exponent * ((of->degrees + width) / (of->degrees + length[k]) / variance[k]);
                gain[k] /= 1.0f + weight * residual.energy[k] * gain[k];
                mean[k] += weight * residual.product[k] * gain[k];
            }
            memcpy(next_mean + at, mean, size);
            memcpy(next_gain + at, gain, size);
            for (Py_ssize_t k = 0; k < lanes; k++)
                log_densities[at + k] = log_density[k] + (begin + k < of->states ? log_prior[node[k]] : 0.0f);
        }
    }
}

/* Adds to sums (F, N) the densities of the other components at the states, relative to those of the first ones. */
static void other_components(const Comparison *of, const float *restrict log_densities, double *restrict sums)
{
    const float *log_prior = of->other_spread + of->phalanges * of->others;
    intptr_t next = 0;
    for (Py_ssize_t n = 0; n < of->states;) {
        Py_ssize_t place[LANES], other[LANES], lanes = 0;
        while (lanes < LANES && n < of->states) {
            if (next == of->counts[of->node_of[n]]) {
                next = 0;
                n++;
                continue;
            }
            const Py_ssize_t row = of->starts[of->node_of[n]] + next++;
            const float *of_map = of->of_map + n * of->channels, *away = of->away + row * of->channels;
            for (Py_ssize_t c = 0; c < of->channels; c++) of->signals[c][lanes] = of_map[c] + away[c];
            place[lanes] = n;
            other[lanes++] = row;
        }
        if (of->transform) transformed(of->signals, of->transform, of->channels, of->whitened);
        for (Py_ssize_t f = 0; f < of->phalanges; f++) {
            if (!of->used[f]) continue;
            const Py_ssize_t first = of->bounds[f], count = of->bounds[f + 1] - first, at = f * of->places;
            const float *spread = of->other_spread + f * of->others;
            Lanes mean = {0}, gain = {0}, variance, length, log_density;
            Residuals residual;
            for (int k = 0; k < LANES; k++) variance[k] = 1.0f;
            for (Py_ssize_t k = 0; k < lanes; k++) {
                variance[k] = spread[other[k]] + of->level[f];
                mean[k] = of->mean[at + place[k]];
                gain[k] = of->gain[at + place[k]];
            }
            residuals(of->strain + first, of->whitened + first, count, mean, &residual);
            densities(&residual, gain, variance, (float)count, of->degrees, length, log_density);
            for (Py_ssize_t k = 0; k < lanes; k++) {
                const double ratio = log_density[k] + log_prior[other[k]] - (double)log_densities[at + place[k]];
                sums[at + place[k]] += exp(ratio < 700.0 ? ratio : 700.0); /* a finite number */
            }
        }
    }
}

/* on_map(spread f (F + 1, M), counts n (M,), starts n (M,), away f (n, C), other_spread f (F + 1, n): components;
 *        nodes n (N,), of_map f (N, C), gain f (2, F, N), its mean and variance: of the places;
 *        bounds n (F + 1,): first channel of each phalanx;
 *        strain f (C,), transform f (C, C) that whitens rows as the strain, an upper triangle, or None,
 *        level f (F,), used bool (F,): of the strain;
 *        degrees of freedom, exponent, number of states;
 *        likelihoods d (N,), gain f (2, F, N) after the strain)
 */
static PyObject *on_map(PyObject *self, PyObject *args)
{
    enum { SPREAD, COUNTS, STARTS, AWAY, OTHER_SPREAD, NODES, OF_MAP, GAIN, BOUNDS, STRAIN, TRANSFORM, LEVEL, USED,
           LIKELIHOODS, NEXT_GAIN, ALL };
    Py_buffer a[ALL] = {{0}};
    Comparison of;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*y*y*y*z*y*y*ffnw*w*", &a[SPREAD], &a[COUNTS], &a[STARTS], &a[AWAY],
                          &a[OTHER_SPREAD], &a[NODES], &a[OF_MAP], &a[GAIN], &a[BOUNDS], &a[STRAIN], &a[TRANSFORM],
                          &a[LEVEL], &a[USED], &of.degrees, &of.exponent, &of.states, &a[LIKELIHOODS], &a[NEXT_GAIN]))
        return NULL;
    const Py_ssize_t phalanges = of.phalanges = COUNT(a[LEVEL], float), places = of.places = COUNT(a[NODES], intptr_t);
    of.channels = COUNT(a[STRAIN], float);
    of.nodes = COUNT(a[COUNTS], intptr_t);
    of.others = COUNT(a[OTHER_SPREAD], float) / (phalanges + 1);
    of.spread = a[SPREAD].buf, of.away = a[AWAY].buf, of.other_spread = a[OTHER_SPREAD].buf;
    of.of_map = a[OF_MAP].buf, of.mean = a[GAIN].buf, of.gain = of.mean + phalanges * places;
    of.strain = a[STRAIN].buf, of.transform = a[TRANSFORM].buf, of.level = a[LEVEL].buf, of.used = a[USED].buf;
    of.counts = a[COUNTS].buf, of.starts = a[STARTS].buf, of.node_of = a[NODES].buf, of.bounds = a[BOUNDS].buf;
    double *likelihoods = a[LIKELIHOODS].buf, *sums = NULL; /* of a place's densities, relative to its first one */
    float *next_mean = a[NEXT_GAIN].buf, *log_densities = NULL;
    Lanes *signals = NULL;
    if (!(HAS(SPREAD, (phalanges + 1) * of.nodes, float) && HAS(STARTS, of.nodes, intptr_t) &&
          HAS(AWAY, of.others * of.channels, float) && HAS(OF_MAP, places * of.channels, float) &&
          HAS(GAIN, 2 * phalanges * places, float) && HAS(BOUNDS, phalanges + 1, intptr_t) &&
          (!of.transform || HAS(TRANSFORM, of.channels * of.channels, float)) && HAS(USED, phalanges, char) &&
          HAS(LIKELIHOODS, places, double) && HAS(NEXT_GAIN, 2 * phalanges * places, float)))
        goto end;
    signals = PyMem_Calloc((size_t)(2 * of.channels), sizeof(Lanes));
    log_densities = PyMem_Malloc((size_t)(phalanges * places) * sizeof(float));
    sums = PyMem_Malloc((size_t)(phalanges * places) * sizeof(double));
    if (!signals || !log_densities || !sums) {
        PyErr_NoMemory();
        goto end;
    }
    of.states = of.states < places ? of.states : places;
    of.signals = signals;
    of.whitened = of.transform ? signals + of.channels : signals;
    for (Py_ssize_t k = 0; k < phalanges * places; k++) sums[k] = 1.0;
    first_components(&of, log_densities, next_mean, next_mean + phalanges * places);
    other_components(&of, log_densities, sums);
    for (Py_ssize_t n = 0; n < places; n++) {
        likelihoods[n] = 0.0;
        for (Py_ssize_t f = 0, at = n; f < phalanges; f++, at += places)
            if (of.used[f]) likelihoods[n] += log_densities[at] + (sums[at] > 1.0 ? log(sums[at]) : 0.0);
    }
end:
    PyMem_Free(sums);
    PyMem_Free(log_densities);
    PyMem_Free(signals);
    release(a, ALL);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* Adds to moments (count, count), whose rows are so far apart, those of residuals (count,) with weights. */
static void add_moments(const Lanes *restrict residual, const float *restrict weights, Py_ssize_t count,
                        double *restrict moments, Py_ssize_t apart)
{
    for (Py_ssize_t row = 0; row < count; row++) {
        Lanes weighted;
        for (int k = 0; k < LANES; k++) weighted[k] = weights[k] * residual[row][k];
        for (Py_ssize_t c = 0; c <= row; c++) {
            float sum = 0.0f;
            for (int k = 0; k < LANES; k++) sum += weighted[k] * residual[c][k];
            moments[row * apart + c] += sum;
            if (c < row) moments[c * apart + row] += sum;
        }
    }
}

/* scatter(spread f (F + 1, M): first components; nodes n (N,), of_map f (N, C), gain f (2, F, N): of the places;
 *         bounds n (F + 1,); strain f (C,), transform f (C, C) or None, level f (F,): of the strain, as of on_map;
 *         weights d (P,) of the states, the least that counts, in variances the largest mean square;
 *         moments d (C, C), a block per phalanx)
 */
static PyObject *scatter(PyObject *self, PyObject *args)
{
    enum { SPREAD, NODES, OF_MAP, GAIN, BOUNDS, STRAIN, TRANSFORM, LEVEL, WEIGHTS, MOMENTS, ALL };
    Py_buffer a[ALL] = {{0}};
    double least;
    float largest;
    Lanes *signals = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*z*y*y*dfw*", &a[SPREAD], &a[NODES], &a[OF_MAP], &a[GAIN], &a[BOUNDS],
                          &a[STRAIN], &a[TRANSFORM], &a[LEVEL], &a[WEIGHTS], &least, &largest, &a[MOMENTS]))
        return NULL;
    const Py_ssize_t phalanges = COUNT(a[LEVEL], float), channels = COUNT(a[STRAIN], float);
    const Py_ssize_t places = COUNT(a[NODES], intptr_t), states = COUNT(a[WEIGHTS], double);
    const Py_ssize_t nodes = COUNT(a[SPREAD], float) / (phalanges + 1);
    const float *spread = a[SPREAD].buf, *of_map = a[OF_MAP].buf, *mean = a[GAIN].buf;
    const float *strain = a[STRAIN].buf, *transform = a[TRANSFORM].buf, *level = a[LEVEL].buf;
    const intptr_t *node_of = a[NODES].buf, *bounds = a[BOUNDS].buf;
    const double *weights = a[WEIGHTS].buf;
    double *moments = a[MOMENTS].buf;
    if (!(HAS(OF_MAP, places * channels, float) && HAS(GAIN, 2 * phalanges * places, float) &&
          HAS(BOUNDS, phalanges + 1, intptr_t) && (!transform || HAS(TRANSFORM, channels * channels, float)) &&
          HAS(MOMENTS, channels * channels, double)))
        goto end;
    signals = PyMem_Calloc((size_t)(2 * channels), sizeof(Lanes));
    if (!signals) {
        PyErr_NoMemory();
        goto end;
    }
    Lanes *residual = transform ? signals + channels : signals;
    memset(moments, 0, (size_t)(channels * channels) * sizeof(double));
    for (Py_ssize_t n = 0; n < states && n < places;) {
        Py_ssize_t place[LANES], lanes = 0;
        for (; lanes < LANES && n < states && n < places; n++) {
            if (!(weights[n] > least)) continue;
            for (Py_ssize_t c = 0; c < channels; c++) signals[c][lanes] = of_map[n * channels + c];
            place[lanes++] = n;
        }
        if (transform) transformed(signals, transform, channels, residual);
        for (Py_ssize_t f = 0; f < phalanges; f++) {
            const Py_ssize_t begin = bounds[f], end = bounds[f + 1];
            Lanes of_mean = {0}, variance, weight = {0}, squared = {0};
            for (int k = 0; k < LANES; k++) variance[k] = 1.0f;
            for (Py_ssize_t k = 0; k < lanes; k++) {
                of_mean[k] = mean[f * places + place[k]];
                variance[k] = spread[f * nodes + node_of[place[k]]] + level[f];
                weight[k] = (float)weights[place[k]];
            }
            for (Py_ssize_t c = begin; c < end; c++) {
                for (int k = 0; k < LANES; k++) {
                    residual[c][k] = strain[c] - of_mean[k] * residual[c][k];
                    squared[k] += residual[c][k] * residual[c][k];
                }
            }
            for (int k = 0; k < LANES; k++) {
                const float mean_square = squared[k] / (variance[k] * (float)(end - begin));
                weight[k] *= (mean_square > largest ? largest / mean_square : 1.0f) / variance[k];
            }
            add_moments(residual + begin, weight, end - begin, moments + begin * (channels + 1), channels);
        }
    }
end:
    PyMem_Free(signals);
    release(a, ALL);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* average(before d (C, C), moments d (C, C), bounds n (F + 1,), used bool (F,), share of the moments;
 *         after d (C, C), and of each phalanx the mean variance d (F,), and the root of the sum of squares d (F,))
 */
static PyObject *average(PyObject *self, PyObject *args)
{
    enum { BEFORE, MOMENTS, BOUNDS, USED, AFTER, VARIANCE, MOST, ALL };
    Py_buffer a[ALL] = {{0}};
    double share;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*dw*w*w*", &a[BEFORE], &a[MOMENTS], &a[BOUNDS], &a[USED], &share, &a[AFTER],
                          &a[VARIANCE], &a[MOST]))
        return NULL;
    const Py_ssize_t phalanges = COUNT(a[USED], char);
    const intptr_t *bounds = a[BOUNDS].buf;
    const Py_ssize_t channels = HAS(BOUNDS, phalanges + 1, intptr_t) ? bounds[phalanges] : 0;
    const double *before = a[BEFORE].buf, *moments = a[MOMENTS].buf;
    double *after = a[AFTER].buf;
    const bool fits = !PyErr_Occurred() && HAS(BEFORE, channels * channels, double) &&
                      HAS(MOMENTS, channels * channels, double) && HAS(AFTER, channels * channels, double) &&
                      HAS(VARIANCE, phalanges, double) && HAS(MOST, phalanges, double);
    for (Py_ssize_t f = 0; fits && f < phalanges; f++) {
        const double counted = ((const char *)a[USED].buf)[f] ? share : 0.0;
        double trace = 0.0, squares = 0.0;
        for (intptr_t row = bounds[f]; row < bounds[f + 1]; row++) {
            for (Py_ssize_t c = 0; c < channels; c++) {
                const Py_ssize_t at = row * channels + c;
                after[at] = before[at] + counted * (moments[at] - before[at]);
                squares += after[at] * after[at];
            }
            trace += after[row * channels + row];
        }
        ((double *)a[VARIANCE].buf)[f] = trace / (double)(bounds[f + 1] - bounds[f]);
        ((double *)a[MOST].buf)[f] = sqrt(squares);
    }
    release(a, ALL);
    if (!fits) return NULL;
    Py_RETURN_NONE;
}

/* off_map(spread d (G, C), rotation d (C, C), variance d (F,), bounds n (F + 1,): of the material; weights d (G, F),
 *         innovation d (C,), level d (F,), used bool (F,), degrees of freedom, exponent, fraction that is forgotten;
 *         following d (G, F)): log-likelihood
 */
static PyObject *off_map(PyObject *self, PyObject *args)
{
    enum { SPREAD, ROTATION, VARIANCE, BOUNDS, WEIGHTS, INNOVATION, LEVEL, USED, FOLLOWING, ALL };
    Py_buffer a[ALL] = {{0}};
    double degrees, exponent, forgotten, likelihood = 0.0, *memory = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*y*dddw*", &a[SPREAD], &a[ROTATION], &a[VARIANCE], &a[BOUNDS],
                          &a[WEIGHTS], &a[INNOVATION], &a[LEVEL], &a[USED], &degrees, &exponent, &forgotten,
                          &a[FOLLOWING]))
        return NULL;
    const Py_ssize_t channels = COUNT(a[INNOVATION], double), phalanges = COUNT(a[LEVEL], double);
    const Py_ssize_t strengths = COUNT(a[WEIGHTS], double) / phalanges;
    const double *spread = a[SPREAD].buf, *rotation = a[ROTATION].buf, *variance = a[VARIANCE].buf;
    const double *weights = a[WEIGHTS].buf, *innovation = a[INNOVATION].buf, *level = a[LEVEL].buf;
    const intptr_t *bounds = a[BOUNDS].buf;
    double *following = a[FOLLOWING].buf;
    if (!(HAS(SPREAD, strengths * channels, double) && HAS(ROTATION, channels * channels, double) &&
          HAS(VARIANCE, phalanges, double) && HAS(BOUNDS, phalanges + 1, intptr_t) &&
          HAS(WEIGHTS, strengths * phalanges, double) && HAS(USED, phalanges, char) &&
          HAS(FOLLOWING, strengths * phalanges, double)))
        goto end;
    memory = PyMem_Malloc((size_t)(channels + strengths) * sizeof(double));
    if (!memory) {
        PyErr_NoMemory();
        goto end;
    }
    double *squared = memory, *densities = memory + channels;
    for (Py_ssize_t c = 0; c < channels; c++) squared[c] = 0.0;
    for (Py_ssize_t row = 0; row < channels; row++)
        for (Py_ssize_t c = 0; c < channels; c++) squared[c] += innovation[row] * rotation[row * channels + c];
    for (Py_ssize_t c = 0; c < channels; c++) squared[c] *= squared[c];
    for (Py_ssize_t f = 0; f < phalanges; f++) {
        double peak = -INFINITY, total = 0.0, sum = 0.0;
        for (Py_ssize_t g = 0; g < strengths; g++) {
            double length = 0.0, volume = 0.0;
            for (intptr_t c = bounds[f]; c < bounds[f + 1]; c++) {
                const double along = spread[g * channels + c] + (variance[f] + level[f]);
                length += squared[c] / along;
                volume += log(along);
            }
            const double width = (double)(bounds[f + 1] - bounds[f]);
            densities[g] = -0.5 * ((degrees + width) * log1p(length / degrees) + volume);
            peak = densities[g] > peak ? densities[g] : peak;
        }
        for (Py_ssize_t g = 0; g < strengths; g++) {
            const double before = weights[g * phalanges + f], density = densities[g] - peak;
            total += before * exp(density);
            sum += following[g * phalanges + f] = before * exp(exponent * density);
        }
        const bool counts = ((const char *)a[USED].buf)[f];
        for (Py_ssize_t g = 0; g < strengths; g++) {
            double *after = following + g * phalanges + f, even = 1.0 / (double)strengths;
            *after = counts ? *after / sum + forgotten * (even - *after / sum) : weights[g * phalanges + f];
        }
        likelihood += counts ? log(total) + peak : 0.0;
    }
end:
    PyMem_Free(memory);
    release(a, ALL);
    return PyErr_Occurred() ? NULL : PyFloat_FromDouble(likelihood);
}

/* bayes(prior d (P,), log_likelihood d (P,); posterior d (P,)): log-marginal; -inf: impossible, without a posterior */
static PyObject *bayes(PyObject *self, PyObject *args)
{
    enum { PRIOR, LIKELIHOOD, POSTERIOR, ALL };
    Py_buffer a[ALL] = {{0}};
    double peak = -INFINITY, total = 0.0;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*w*", &a[PRIOR], &a[LIKELIHOOD], &a[POSTERIOR])) return NULL;
    const Py_ssize_t states = COUNT(a[PRIOR], double);
    const double *prior = a[PRIOR].buf, *log_likelihood = a[LIKELIHOOD].buf;
    double *posterior = a[POSTERIOR].buf;
    const bool fits = HAS(LIKELIHOOD, states, double) && HAS(POSTERIOR, states, double);
    for (Py_ssize_t n = 0; fits && n < states; n++)
        if (prior[n] > 0.0 && !(log_likelihood[n] <= peak)) peak = log_likelihood[n];
    if (fits && peak != -INFINITY) {
        for (Py_ssize_t n = 0; n < states; n++) {
            posterior[n] = prior[n] > 0.0 ? prior[n] * exp(log_likelihood[n] - peak) : 0.0;
            total += posterior[n];
        }
        for (Py_ssize_t n = 0; n < states; n++) posterior[n] /= total;
        peak += log(total);
    }
    release(a, ALL);
    return fits ? PyFloat_FromDouble(peak) : NULL;
}

static const double PI = 3.14159265358979323846;

/* moments(states d (d, P), weights d (P,), wraps bool (d,); mean d (d,), covariance d (d, d)) */
static PyObject *moments(PyObject *self, PyObject *args)
{
    enum { STATES, WEIGHTS, WRAPS, MEAN, COVARIANCE, ALL };
    Py_buffer a[ALL] = {{0}};
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &a[STATES], &a[WEIGHTS], &a[WRAPS], &a[MEAN], &a[COVARIANCE]))
        return NULL;
    const Py_ssize_t axes = COUNT(a[WRAPS], char), count = COUNT(a[WEIGHTS], double);
    const double *weights = a[WEIGHTS].buf, *states = a[STATES].buf;
    double *mean = a[MEAN].buf, *covariance = a[COVARIANCE].buf;
    double *deviation = PyMem_Malloc((size_t)(axes * count) * sizeof(double));
    if (!deviation) PyErr_NoMemory();
    const bool fits = deviation && HAS(STATES, axes * count, double) && HAS(MEAN, axes, double) &&
                      HAS(COVARIANCE, axes * axes, double);
    for (Py_ssize_t axis = 0; fits && axis < axes; axis++) {
        const bool turns = ((const char *)a[WRAPS].buf)[axis];
        const double *along = states + axis * count;
        double *from_mean = deviation + axis * count, sum = 0.0, sine = 0.0, cosine = 0.0;
        for (Py_ssize_t n = 0; !turns && n < count; n++) sum += weights[n] * along[n];
        for (Py_ssize_t n = 0; turns && n < count; n++) {
            sine += weights[n] * sin(along[n]);
            cosine += weights[n] * cos(along[n]);
        }
        mean[axis] = turns ? atan2(sine, cosine) : sum;
        for (Py_ssize_t n = 0; n < count; n++) from_mean[n] = along[n] - mean[axis];
        for (Py_ssize_t n = 0; turns && n < count; n++)
            from_mean[n] -= 2.0 * PI * floor((from_mean[n] + PI) / (2.0 * PI));
        for (Py_ssize_t other = 0; other <= axis; other++) {
            const double *from_other = deviation + other * count;
            double product = 0.0;
            for (Py_ssize_t n = 0; n < count; n++) product += weights[n] * (from_mean[n] * from_other[n]);
            covariance[axis * axes + other] = covariance[other * axes + axis] = product;
        }
    }
    PyMem_Free(deviation);
    release(a, ALL);
    if (!fits) return NULL;
    Py_RETURN_NONE;
}

/* probability_within(away d (d, P), radius d (d,), sums d (3,), factors d (3, d), reach, weights d (P,)) */
static PyObject *probability_within(PyObject *self, PyObject *args)
{
    enum { AWAY, RADIUS, SUMS, FACTORS, WEIGHTS, ALL };
    Py_buffer a[ALL] = {{0}};
    double reach, probability = 0.0;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*y*y*y*dy*", &a[AWAY], &a[RADIUS], &a[SUMS], &a[FACTORS], &reach, &a[WEIGHTS]))
        return NULL;
    const Py_ssize_t axes = COUNT(a[RADIUS], double), states = COUNT(a[WEIGHTS], double);
    const double *away = a[AWAY].buf, *radius = a[RADIUS].buf, *sums = a[SUMS].buf, *factors = a[FACTORS].buf;
    const double *weights = a[WEIGHTS].buf;
    const bool fits = HAS(AWAY, axes * states, double) && HAS(SUMS, 3, double) && HAS(FACTORS, 3 * axes, double);
    for (Py_ssize_t n = 0; fits && n < states; n++) {
        double length = 0.0, first = sums[0], second = sums[1], third = sums[2]; /* cumulants of the quadratic form */
        for (Py_ssize_t axis = 0; axis < axes; axis++) {
            const double along = away[axis * states + n] / radius[axis], squared = along * along;
            length += squared;
            first += factors[axis] * squared;
            second += factors[axes + axis] * squared;
            third += factors[2 * axes + axis] * squared;
        }
        if (!(length <= reach)) continue;
        const double power = 1.0 - first * third * (2.0 / 3.0) / (second * second), scale = second / (first * first);
        const double deviate = (pow(first, -power) - 1.0 - scale * power * (power - 1.0)) / (power * sqrt(2.0 * scale));
        /* The normal distribution function, within 0.0002. */
        probability += weights[n] / (1.0 + exp(-deviate * (1.5976 + 0.07056 * (deviate * deviate))));
    }
    release(a, ALL);
    return fits ? PyFloat_FromDouble(probability) : NULL;
}

static PyMethodDef METHODS[] = {
    {"map_at", map_at, METH_VARARGS, "Nodes nearest to places, and the strain there."},
    {"noise", noise, METH_VARARGS, "Noise of a sweep after a strain, unless that is a spike."},
    {"move_cells", move_cells, METH_VARARGS, "Belief on the cells of a grid after a motion."},
    {"living", living, METH_VARARGS, "Cells of a grid that have weight, and from which of those before they moved."},
    {"follow", follow, METH_VARARGS, "What is known along trajectories, of what was along their ancestors."},
    {"anchors", anchors, METH_VARARGS, "Where the anchors are after a motion, and which of them left at a bound."},
    {"far_from", far_from, METH_VARARGS, "Values of the anchors that are far from a place."},
    {"drift", drift, METH_VARARGS, "What of a strain and of the map their trends do not predict, and trends after it."},
    {"on_map", on_map, METH_VARARGS, "Likelihoods of a strain at places of the map."},
    {"scatter", scatter, METH_VARARGS, "Second moments of the residuals of a strain from the map."},
    {"average", average, METH_VARARGS, "Second moments averaged over strains, and what is large of them."},
    {"off_map", off_map, METH_VARARGS, "Log-likelihood of a strain on other material, and the weights after it."},
    {"bayes", bayes, METH_VARARGS, "Weights after a measurement, and the logarithm of its likelihood."},
    {"moments", moments, METH_VARARGS, "Mean and covariance of weighted states."},
    {"probability_within", probability_within, METH_VARARGS, "Probability that the hand is within an ellipsoid."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_compiled", NULL, -1, METHODS, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__compiled(void)
{
    return PyModule_Create(&MODULE);
}
