/* The sampled loop around a plant with rolling friction, by hand: one job after another, each step solved implicitly.

   The same algorithm as fraexp's scalar kernel, with the law written into it. Arguments as in lanes.c. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#define MOST 256 /* rows of a memory */

static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }

static inline double law(const double *z, double dy, double *z_next, const double *stiffness, const double *limit) {
    double force = 0.0;
    for (int i = 0; i < ELEMENTS; i++) {
        z_next[i] = least(most(z[i] + dy, -limit[i]), limit[i]);
        force += stiffness[i] * z_next[i];
    }
    return force;
}

/* Multiply a matrix with a vector, four rows at a time. */
static inline void multiply(const double *matrix, const double *vector, double *result, int64_t rows, int64_t columns) {
    int64_t row = 0;
    for (; row + 4 <= rows; row += 4) {
        const double *a = matrix + row * columns, *b = a + columns, *c = b + columns, *d = c + columns;
        double first = a[0] * vector[0], second = b[0] * vector[0], third = c[0] * vector[0], fourth = d[0] * vector[0];
        for (int64_t i = 1; i < columns; i++) {
            first += a[i] * vector[i], second += b[i] * vector[i];
            third += c[i] * vector[i], fourth += d[i] * vector[i];
        }
        result[row] = first, result[row + 1] = second, result[row + 2] = third, result[row + 3] = fourth;
    }
    for (; row < rows; row++) {
        double first = matrix[row * columns] * vector[0];
        for (int64_t i = 1; i < columns; i++) first += matrix[row * columns + i] * vector[i];
        result[row] = first;
    }
}

int64_t run(const double *store, const int64_t *size, const double *waves, const double *goals, const int64_t *begin,
            const int64_t *period, int64_t batches, int64_t ramp, int64_t record, double base, double rate,
            double resolution, double stroke, double *history, double *others, double *pool) {
    const int64_t n = size[0], m = size[1], order = size[2], late = size[3], held = size[4];
    const int64_t samples = ramp + record;
    const double *matrix = store, *compliance = matrix + (m + 1 + n) * (n + 3), *responses = compliance + m * m;
    const double *durations = responses + (n + 1) * m; /* of the steps, which rolling elements do not need */
    const double *numerator = durations + m, *denominator = numerator + order;
    const double *stiffness = denominator + order, *limit = stiffness + ELEMENTS;
    double known[MOST], linear[MOST], w[MOST], inputs[MOST], outputs[MOST], memory[2][ELEMENTS];
    for (int64_t batch = 0; batch < batches; batch++) {
        double place = 0.0, force = 0.0, before = 0.0, secant = 0.0, elapsed = 0.0;
        double *z = memory[0], *z_next = memory[1];
        int64_t phase = 0;
        memset(known, 0, sizeof known), memset(w, 0, sizeof w), memset(inputs, 0, sizeof inputs);
        memset(outputs, 0, sizeof outputs), memset(memory, 0, sizeof memory);
        for (int64_t k = 0; k < samples; k++) {
            double excitation = waves[begin[batch] + phase] * least(base + rate * elapsed, 1.0);
            double reference = goals[batch], position = outputs[held];
            phase = phase + 1 < period[batch] ? phase + 1 : 0;
            elapsed += 1.0;
            if (resolution > 0.0) position = rint(position / resolution) * resolution;
            for (int64_t i = late + 1; i > 0; i--) inputs[i] = inputs[i - 1];
            double error = reference - position, control = numerator[0] * error + w[0];
            for (int64_t i = 1; i < order; i++) w[i - 1] = numerator[i] * error - denominator[i] * control + w[i];
            control += excitation;
            inputs[0] = control;
            const double place_now = place, force_now = force;
            known[n] = inputs[late + 1], known[n + 1] = inputs[late], known[n + 2] = force;
            multiply(matrix, known, linear, m + 1 + n, n + 3);
            for (int64_t j = 0; j < m; j++) {
                double a = linear[j];
                for (int64_t i = 0; i < j; i++) a += compliance[j * m + i] * linear[i];
                const double gain = -compliance[j * m + j];
                double y = a - gain * (2.0 * force - before);
                double after = law(z, y - place, z_next, stiffness, limit);
                double residual = y - a + gain * after, slope = 1.0 + gain * secant;
                double low = -INFINITY, high = INFINITY;
                for (int i = 0; i < 60 && fabs(residual) > 1e-7 * fabs(y - place) + 1e-17; i++) {
                    if (residual > 0.0) high = y;
                    else low = y;
                    double trial = y - residual / slope;
                    if (!(low < trial && trial < high)) trial = 0.5 * (low + high);
                    if (trial == y) break;
                    after = law(z, trial - place, z_next, stiffness, limit);
                    const double next = trial - a + gain * after;
                    slope = most((next - residual) / (trial - y), 1.0);
                    y = trial, residual = next;
                }
                if (y != place) secant = most((after - force) / (y - place), 0.0);
                before = force, force = after, place = y;
                linear[j] = force;
                double *swap = z;
                z = z_next, z_next = swap;
            }
            for (int64_t i = held; i > 0; i--) outputs[i] = outputs[i - 1];
            double newest = linear[m];
            for (int64_t j = 0; j < m; j++) newest += responses[j] * linear[j];
            outputs[0] = newest;
            for (int64_t i = 1; i < n + 1; i++) {
                known[i - 1] = linear[m + i];
                for (int64_t j = 0; j < m; j++) known[i - 1] += responses[i * m + j] * linear[j];
            }
            history[k] = position;
            if (k >= ramp) {
                others[k - ramp] = control;
                others[record + k - ramp] = place_now;
                others[2 * record + k - ramp] = force_now;
            }
            if (!(fabs(newest) < stroke)) return batch;
        }
        memcpy(pool, history, samples * sizeof(double));
        memcpy(pool + samples, others, 3 * record * sizeof(double));
        pool += samples + 3 * record;
    }
    return batches;
}
