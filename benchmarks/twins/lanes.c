/* The sampled loop around a plant with rolling friction, by hand: sixteen jobs side by side in vector registers.

   The algorithm of fraexp's kernel in lanes: predict the displacement, evaluate the law there, correct the state. It is
   written for one machine, as fast as we know how: all sizes are fixed when it is compiled, the constants are broadcast
   to the lanes, two vectors of the widest registers are in flight, each sum of force has two parts, no number is
   divided in the loop, and what a sample leaves goes to memory in rows of lanes, which are transposed 64 samples at a
   time.

     gcc -DELEMENTS=20 -DSTATES=6 -DSTEPS=2 -DORDER=2 -DLATE=2 -DHELD=0 ...
*/

#include <math.h>
#include <stdint.h>
#include <string.h>
#if defined(__AVX__)
#include <immintrin.h>
#endif

#define WIDTH 16
#define CHUNK 64 /* samples whose rows are transposed together */
#define TILE 4 /* samples, and lanes, of the matrices that are transposed in registers */
#if defined(__AVX512F__)
#define REGISTER 8
#else
#define REGISTER 4
#endif
#define PARTS (WIDTH / REGISTER)
#define EACH_PART _Pragma("GCC unroll 8") for (int p = 0; p < PARTS; p++)
#define UNROLLED _Pragma("GCC unroll 100")
#define INLINE static inline __attribute__((always_inline))
#define ROWS (STEPS + 1 + STATES)
#define COLUMNS (STATES + 3)

typedef double part __attribute__((vector_size(8 * REGISTER)));
typedef double tile __attribute__((vector_size(8 * TILE)));
typedef double loose_tile __attribute__((vector_size(8 * TILE), aligned(8)));
typedef int64_t order __attribute__((vector_size(8 * TILE)));
typedef struct { part p[PARTS]; } lanes;
enum { POSITION, CONTROL, DISPLACEMENT, FORCE, CHANNELS };

#if defined(__AVX512F__)
INLINE part least(part a, part b) { return (part)_mm512_min_pd((__m512d)a, (__m512d)b); }
INLINE part most(part a, part b) { return (part)_mm512_max_pd((__m512d)a, (__m512d)b); }
INLINE part nearest(part a) { return (part)_mm512_roundscale_pd((__m512d)a, 0); }
#elif defined(__AVX__)
INLINE part least(part a, part b) { return (part)_mm256_min_pd((__m256d)a, (__m256d)b); }
INLINE part most(part a, part b) { return (part)_mm256_max_pd((__m256d)a, (__m256d)b); }
INLINE part nearest(part a) { return (part)_mm256_round_pd((__m256d)a, 0); }
#else
INLINE part least(part a, part b) { UNROLLED for (int i = 0; i < REGISTER; i++) a[i] = b[i] < a[i] ? b[i] : a[i]; return a; }
INLINE part most(part a, part b) { UNROLLED for (int i = 0; i < REGISTER; i++) a[i] = b[i] > a[i] ? b[i] : a[i]; return a; }
INLINE part nearest(part a) { UNROLLED for (int i = 0; i < REGISTER; i++) a[i] = rint(a[i]); return a; }
#endif

INLINE part fill(double value) { return (part){} + value; }
INLINE lanes filled(double value) { lanes r; EACH_PART r.p[p] = fill(value); return r; }
INLINE lanes sum(lanes a, lanes b) { EACH_PART a.p[p] += b.p[p]; return a; }
INLINE lanes difference(lanes a, lanes b) { EACH_PART a.p[p] -= b.p[p]; return a; }
INLINE lanes product(lanes a, lanes b) { EACH_PART a.p[p] *= b.p[p]; return a; }
INLINE lanes add_product(lanes a, double constant, lanes b) { EACH_PART a.p[p] += constant * b.p[p]; return a; }

INLINE lanes gathered(const double *row, const int64_t *from) {
    lanes r;
    UNROLLED for (int i = 0; i < WIDTH; i++) r.p[i / REGISTER][i % REGISTER] = row[from[i]];
    return r;
}

INLINE int all_within(lanes a, double limit) {
#if defined(__AVX512F__)
    __mmask8 inside = 0xff;
    EACH_PART inside &= _mm512_cmp_pd_mask((__m512d)_mm512_abs_pd((__m512d)a.p[p]), _mm512_set1_pd(limit), _CMP_LT_OQ);
    return inside == 0xff;
#else
    int64_t all = -1;
    EACH_PART for (int i = 0; i < REGISTER; i++) all &= ((a.p[p] < fill(limit)) & (a.p[p] > fill(-limit)))[i];
    return all != 0;
#endif
}

/* The law may write where it has read, because it is evaluated once. */
INLINE lanes law(lanes *z, lanes dy, const double *stiffness, const double *limit) {
    lanes force[2] = {filled(0.0), filled(0.0)};
    UNROLLED for (int i = 0; i < ELEMENTS; i++) {
        lanes moved = sum(z[i], dy);
        EACH_PART moved.p[p] = least(most(moved.p[p], fill(-limit[i])), fill(limit[i]));
        z[i] = moved;
        force[i % 2] = add_product(force[i % 2], stiffness[i], moved);
    }
    return sum(force[0], force[1]);
}

/* Multiply a matrix with a vector, four rows at a time. */
INLINE void multiply(const double *matrix, const lanes *vector, lanes *result) {
    UNROLLED for (int row = 0; row < ROWS; row += 4) {
        lanes sums[4] = {filled(0.0), filled(0.0), filled(0.0), filled(0.0)};
        UNROLLED for (int i = 0; i < COLUMNS; i++) {
            UNROLLED for (int j = 0; j < 4; j++) {
                if (row + j < ROWS) sums[j] = add_product(sums[j], matrix[(row + j) * COLUMNS + i], vector[i]);
            }
        }
        UNROLLED for (int j = 0; j < 4; j++) {
            if (row + j < ROWS) result[row + j] = sums[j];
        }
    }
}

/* Write `samples` rows of lanes to `target`, one row for each lane, `stride` numbers apart. */
static void transpose(const lanes *rows, int64_t samples, double *target, int64_t stride) {
    const double *numbers = (const double *)rows;
    int64_t k = 0;
    for (; k + TILE <= samples; k += TILE) {
        for (int lane = 0; lane < WIDTH; lane += TILE) {
            const double *from = numbers + k * WIDTH + lane;
            tile a = *(tile *)from, b = *(tile *)(from + WIDTH), c = *(tile *)(from + 2 * WIDTH), d = *(tile *)(from + 3 * WIDTH);
            tile ab = __builtin_shuffle(a, b, (order){0, 4, 2, 6}), ba = __builtin_shuffle(a, b, (order){1, 5, 3, 7});
            tile cd = __builtin_shuffle(c, d, (order){0, 4, 2, 6}), dc = __builtin_shuffle(c, d, (order){1, 5, 3, 7});
            double *to = target + lane * stride + k;
            *(loose_tile *)to = __builtin_shuffle(ab, cd, (order){0, 1, 4, 5});
            *(loose_tile *)(to + stride) = __builtin_shuffle(ba, dc, (order){0, 1, 4, 5});
            *(loose_tile *)(to + 2 * stride) = __builtin_shuffle(ab, cd, (order){2, 3, 6, 7});
            *(loose_tile *)(to + 3 * stride) = __builtin_shuffle(ba, dc, (order){2, 3, 6, 7});
        }
    }
    for (; k < samples; k++) {
        for (int lane = 0; lane < WIDTH; lane++) target[lane * stride + k] = numbers[k * WIDTH + lane];
    }
}

/* Run `batches` times WIDTH jobs of `ramp` + `record` samples from rest.

   `store` holds the constants of fraexp's `DiscreteLoop`, K_i and Y_i; `goals` the reference of each job; `pool` receives,
   job by job, all positions, then control input, displacement and friction force of the record. Returns how many batches
   stayed within the limit. */
int64_t run(const double *store, const int64_t *size, const double *waves, const double *goals, const int64_t *begin,
            const int64_t *period, int64_t batches, int64_t ramp, int64_t record, double base, double rate,
            double resolution, double stroke, double *history, double *others, double *pool) {
    const int64_t samples = ramp + record, job = samples + 3 * record;
    const double *matrix = store, *compliance = matrix + ROWS * COLUMNS, *responses = compliance + STEPS * STEPS;
    const double *durations = responses + (STATES + 1) * STEPS; /* of the steps, which rolling elements do not need */
    const double *numerator = durations + STEPS, *denominator = numerator + ORDER;
    const double *stiffness = denominator + ORDER, *limit = stiffness + ELEMENTS;
    const double inverse = resolution > 0.0 ? 1.0 / resolution : 0.0;
    static __thread lanes trace[CHANNELS][CHUNK + 1]; /* one row more: channels do not lie whole pages apart */
    lanes known[COLUMNS], linear[ROWS], w[ORDER], inputs[LATE + 2], outputs[HELD + 1], z[ELEMENTS];
    for (int64_t batch = 0; batch < batches; batch++, begin += WIDTH, period += WIDTH, goals += WIDTH, pool += WIDTH * job) {
        lanes place = filled(0.0), force = place, before = place, reference;
        memcpy(&reference, goals, sizeof reference);
        int64_t from[WIDTH] = {}, turn = 0, elapsed = 0;
        memset(known, 0, sizeof known), memset(w, 0, sizeof w), memset(inputs, 0, sizeof inputs);
        memset(outputs, 0, sizeof outputs), memset(z, 0, sizeof z);
        for (int64_t k = 0; k < samples;) {
            if (k == turn) { /* a lane comes to its period's beginning */
                turn = samples;
                for (int lane = 0; lane < WIDTH; lane++) {
                    const int64_t phase = k % period[lane], next = k - phase + period[lane];
                    from[lane] = begin[lane] + phase - k;
                    turn = next < turn ? next : turn;
                }
            }
            const int64_t first = k, record_bound = k < ramp ? ramp : samples, chunk_bound = k + CHUNK;
            int64_t last = turn < record_bound ? turn : record_bound;
            last = last < chunk_bound ? last : chunk_bound;
            for (; k < last; k++) {
                const double amplitude = base + rate * (double)elapsed++;
                lanes position = outputs[HELD];
                if (resolution > 0.0) EACH_PART position.p[p] = nearest(position.p[p] * inverse) * resolution;
                UNROLLED for (int i = LATE + 1; i > 0; i--) inputs[i] = inputs[i - 1];
                lanes error = difference(reference, position), control = add_product(w[0], numerator[0], error);
                UNROLLED for (int i = 1; i < ORDER; i++) {
                    w[i - 1] = add_product(add_product(w[i], numerator[i], error), -denominator[i], control);
                }
                control = add_product(control, amplitude < 1.0 ? amplitude : 1.0, gathered(waves + k, from));
                inputs[0] = control;
                trace[POSITION][k - first] = position, trace[CONTROL][k - first] = control;
                trace[DISPLACEMENT][k - first] = place, trace[FORCE][k - first] = force;
                known[STATES] = inputs[LATE + 1], known[STATES + 1] = inputs[LATE], known[STATES + 2] = force;
                multiply(matrix, known, linear);
                UNROLLED for (int j = 0; j < STEPS; j++) {
                    lanes y = linear[j];
                    UNROLLED for (int i = 0; i < j; i++) y = add_product(y, compliance[j * STEPS + i], linear[i]);
                    y = add_product(y, compliance[j * STEPS + j], difference(sum(force, force), before));
                    before = force;
                    force = law(z, difference(y, place), stiffness, limit);
                    linear[j] = force, place = y;
                }
                UNROLLED for (int i = HELD; i > 0; i--) outputs[i] = outputs[i - 1];
                outputs[0] = linear[STEPS];
                UNROLLED for (int j = 0; j < STEPS; j++) outputs[0] = add_product(outputs[0], responses[j], linear[j]);
                UNROLLED for (int i = 1; i < STATES + 1; i++) {
                    lanes state = linear[STEPS + i];
                    UNROLLED for (int j = 0; j < STEPS; j++) state = add_product(state, responses[i * STEPS + j], linear[j]);
                    known[i - 1] = state;
                }
                if (!all_within(outputs[0], stroke)) return batch;
            }
            transpose(trace[POSITION], k - first, pool + first, job);
            if (first >= ramp) {
                for (int channel = 1; channel < CHANNELS; channel++) {
                    double *target = pool + samples + (channel - 1) * record + first - ramp;
                    transpose(trace[channel], k - first, target, job);
                }
            }
        }
    }
    return batches;
}
