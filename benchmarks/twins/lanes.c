/* The sampled loop around a plant with rolling friction, by hand: eight jobs side by side in vector registers.

   The same algorithm as fraexp's kernel in lanes: predict the displacement, evaluate the law there, correct the state.
   Compiled in two ways:
     gcc -DELEMENTS=20                 sizes known at run time, constants of each lane: what fraexp's kernel can do
     gcc -DELEMENTS=20 -DSTATES=6 ...  all sizes fixed, one machine for all lanes, two sums of force: the limit
*/

#include <math.h>
#include <stdint.h>
#include <string.h>
#if defined(__AVX512F__) || defined(__AVX__)
#include <immintrin.h>
#endif

#define WIDTH 8
#define MOST 256 /* rows of a memory */
typedef double lanes __attribute__((vector_size(8 * WIDTH)));
typedef int64_t marks __attribute__((vector_size(8 * WIDTH)));

#ifdef STATES
typedef double constant; /* the same in each lane */
#else
typedef lanes constant;
#endif

static inline lanes fill(double value) { return (lanes){} + value; }

#if defined(__AVX512F__)
static inline lanes least(lanes a, lanes b) { return (lanes)_mm512_min_pd((__m512d)a, (__m512d)b); }
static inline lanes most(lanes a, lanes b) { return (lanes)_mm512_max_pd((__m512d)a, (__m512d)b); }
static inline lanes nearest(lanes a) { return (lanes)_mm512_roundscale_pd((__m512d)a, 0); }
#elif defined(__AVX__)
typedef union { lanes all; __m256d half[2]; } halves;
#define BY_HALVES(name, first, second)                     \
    static inline lanes name(lanes a, lanes b) {           \
        halves x = {a}, y = {b};                           \
        (void)y;                                           \
        x.half[0] = first, x.half[1] = second;             \
        return x.all;                                      \
    }
BY_HALVES(least, _mm256_min_pd(x.half[0], y.half[0]), _mm256_min_pd(x.half[1], y.half[1]))
BY_HALVES(most, _mm256_max_pd(x.half[0], y.half[0]), _mm256_max_pd(x.half[1], y.half[1]))
BY_HALVES(rounded, _mm256_round_pd(x.half[0], 0), _mm256_round_pd(x.half[1], 0))
static inline lanes nearest(lanes a) { return rounded(a, a); }
#else
#define EACH(expression) for (int i = 0; i < WIDTH; i++) a[i] = expression; return a
static inline lanes least(lanes a, lanes b) { EACH(b[i] < a[i] ? b[i] : a[i]); }
static inline lanes most(lanes a, lanes b) { EACH(b[i] > a[i] ? b[i] : a[i]); }
static inline lanes nearest(lanes a) { EACH(rint(a[i])); }
#endif

static inline lanes gathered(const double *row, const int64_t *from) {
    return (lanes){row[from[0]], row[from[1]], row[from[2]], row[from[3]],
                   row[from[4]], row[from[5]], row[from[6]], row[from[7]]};
}

static inline int all_within(lanes a, double limit) {
    marks inside = (a < fill(limit)) & (a > fill(-limit));
#if defined(__AVX512DQ__)
    return _mm512_movepi64_mask((__m512i)inside) == 0xff;
#else
    int64_t all = -1;
    for (int lane = 0; lane < WIDTH; lane++) all &= inside[lane];
    return all != 0;
#endif
}

static inline lanes law(const lanes *z, lanes dy, lanes *z_next, const constant *stiffness, const constant *limit) {
#ifdef STATES
    lanes sum[2] = {};
#pragma GCC unroll 100
    for (int i = 0; i < ELEMENTS; i++) {
        z_next[i] = least(most(z[i] + dy, fill(-limit[i])), fill(limit[i]));
        sum[i % 2] += stiffness[i] * z_next[i];
    }
    return sum[0] + sum[1];
#else
    lanes force = {};
    for (int i = 0; i < ELEMENTS; i++) {
        z_next[i] = least(most(z[i] + dy, -limit[i]), limit[i]);
        force += stiffness[i] * z_next[i];
    }
    return force;
#endif
}

/* Multiply a matrix with a vector, four rows at a time. */
static inline void multiply(const constant *matrix, const lanes *vector, lanes *result, int64_t rows, int64_t columns) {
    int64_t row = 0;
    for (; row + 4 <= rows; row += 4) {
        const constant *a = matrix + row * columns, *b = a + columns, *c = b + columns, *d = c + columns;
        lanes first = a[0] * vector[0], second = b[0] * vector[0], third = c[0] * vector[0], fourth = d[0] * vector[0];
        for (int64_t i = 1; i < columns; i++) {
            first += a[i] * vector[i], second += b[i] * vector[i];
            third += c[i] * vector[i], fourth += d[i] * vector[i];
        }
        result[row] = first, result[row + 1] = second, result[row + 2] = third, result[row + 3] = fourth;
    }
    for (; row < rows; row++) {
        lanes first = matrix[row * columns] * vector[0];
        for (int64_t i = 1; i < columns; i++) first += matrix[row * columns + i] * vector[i];
        result[row] = first;
    }
}

/* Run `batches` times WIDTH jobs of `ramp` + `record` samples from rest.

   `store` holds the constants of fraexp's `Discrete`, K_i and Y_i; `size` the states n, steps a sample m, controller
   order, whole samples of both dead times; `goals` the reference of each job; `pool` receives, job by job, all positions, then
   control input, displacement and friction force of the record. Returns how many batches stayed within the stroke. */
int64_t run(const constant *store, const int64_t *size, const double *waves, const double *goals, const int64_t *begin,
            const int64_t *period, int64_t batches, int64_t ramp, int64_t record, double base, double rate,
            double resolution, double stroke, double *history, double *others, double *pool) {
#ifdef STATES
    (void)size;
    const int n = STATES, m = STEPS, order = ORDER, late = LATE, held = HELD;
#else
    const int64_t n = size[0], m = size[1], order = size[2], late = size[3], held = size[4];
#endif
    const int64_t samples = ramp + record;
    const constant *matrix = store, *compliance = matrix + (m + 1 + n) * (n + 3), *responses = compliance + m * m;
    const constant *numerator = responses + (n + 1) * m, *denominator = numerator + order;
    const constant *stiffness = denominator + order, *limit = stiffness + ELEMENTS;
    lanes known[MOST], linear[MOST], w[MOST], inputs[MOST], outputs[MOST], memory[2][ELEMENTS];
    for (int64_t batch = 0; batch < batches; batch++, begin += WIDTH, period += WIDTH, goals += WIDTH) {
        lanes place = {}, force = {}, before = {}, elapsed = {}, reference;
        memcpy(&reference, goals, sizeof reference);
        lanes *z = memory[0], *z_next = memory[1];
        int64_t from[WIDTH] = {}, turn = 0;
        memset(known, 0, sizeof known), memset(w, 0, sizeof w), memset(inputs, 0, sizeof inputs);
        memset(outputs, 0, sizeof outputs), memset(memory, 0, sizeof memory);
        for (int64_t k = 0; k < samples; k++) {
            if (k == turn) { /* a lane comes to its period's beginning */
                turn = samples;
                for (int lane = 0; lane < WIDTH; lane++) {
                    const int64_t phase = k % period[lane], next = k - phase + period[lane];
                    from[lane] = begin[lane] + phase - k;
                    turn = next < turn ? next : turn;
                }
            }
            lanes excitation = gathered(waves + k, from);
            excitation *= least(base + rate * elapsed, fill(1.0));
            elapsed += 1.0;
            lanes position = outputs[held];
            if (resolution > 0.0) position = nearest(position / resolution) * resolution;
            for (int64_t i = late + 1; i > 0; i--) inputs[i] = inputs[i - 1];
            lanes error = reference - position, control = numerator[0] * error + w[0];
            for (int64_t i = 1; i < order; i++) w[i - 1] = numerator[i] * error - denominator[i] * control + w[i];
            control += excitation;
            inputs[0] = control;
            lanes place_now = place, force_now = force;
            known[n] = inputs[late + 1], known[n + 1] = inputs[late], known[n + 2] = force;
            multiply(matrix, known, linear, m + 1 + n, n + 3);
            for (int64_t j = 0; j < m; j++) {
                lanes a = linear[j];
                for (int64_t i = 0; i < j; i++) a += compliance[j * m + i] * linear[i];
                lanes y = a + compliance[j * m + j] * (2.0 * force - before);
                before = force;
                force = law(z, y - place, z_next, stiffness, limit);
                linear[j] = force;
                place = y;
#ifndef STATES
                lanes *swap = z;
                z = z_next, z_next = swap;
#else
                z_next = z; /* the law is evaluated once: it may write where it has read */
#endif
            }
            for (int64_t i = held; i > 0; i--) outputs[i] = outputs[i - 1];
            lanes newest = linear[m];
            for (int64_t j = 0; j < m; j++) newest += responses[j] * linear[j];
            outputs[0] = newest;
            for (int64_t i = 1; i < n + 1; i++) {
                known[i - 1] = linear[m + i];
                for (int64_t j = 0; j < m; j++) known[i - 1] += responses[i * m + j] * linear[j];
            }
            for (int lane = 0; lane < WIDTH; lane++) history[lane * samples + k] = position[lane];
            if (k >= ramp) {
                const int64_t at = k - ramp;
                for (int lane = 0; lane < WIDTH; lane++) {
                    others[(3 * lane + 0) * record + at] = control[lane];
                    others[(3 * lane + 1) * record + at] = place_now[lane];
                    others[(3 * lane + 2) * record + at] = force_now[lane];
                }
            }
            if (!all_within(newest, stroke)) return batch;
        }
        for (int lane = 0; lane < WIDTH; lane++) {
            memcpy(pool, history + lane * samples, samples * sizeof(double));
            memcpy(pool + samples, others + 3 * lane * record, 3 * record * sizeof(double));
            pool += samples + 3 * record;
        }
    }
    return batches;
}
