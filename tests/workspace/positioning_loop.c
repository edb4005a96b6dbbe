/* A linear-motor table with rolling friction, moved by an exported controller.
 *
 * Written apart from fraexp: modes as equations of motion that are integrated by the classical Runge-Kutta method with
 * 400 steps per sample, and friction as springs that slip, whose force is that of the step's middle. The thrust acts
 * two samples late, and the encoder rounds to 0.1 um. Prints the measured position of each sample [m].
 */
#include <stdio.h>

#define axis_FORCE_LIMIT 1000.0
#include "axis.h"

enum { STEPS = 400, SAMPLES = 400, DELAY = 2, ELEMENTS = 20, STATES = 6 };

static const double sample_time = 500e-6, resolution = 0.1e-6, target = 1.5e-3;
static const double body = 0.132, viscous = 4.69;
static const double mode_frequency[2] = {38.8, 80.0}, mode_damping[2] = {0.04634, 0.02}, mode_gain[2] = {0.342, 0.3};
static double spring[ELEMENTS], slip[ELEMENTS], stretch[ELEMENTS];

/* Springs of the curve Fc (1 - e^(-x/x0)) between 20 knots from 0.5 to 100 um, scaled to end at Fc. */
static void make_guide(void) {
    const double coulomb = 17.9, width = 45.36e-6, first = 0.5e-6, last = 100e-6;
    double slope[ELEMENTS + 1] = {0}, before_x = 0.0, before_g = 0.0;
    for (int i = 0; i < ELEMENTS; ++i) {
        const double x = first * pow(last / first, i / (ELEMENTS - 1.0));
        const double g = coulomb * (1.0 - exp(-x / width)) / (1.0 - exp(-last / width));
        slope[i] = (g - before_g) / (x - before_x);
        slip[i] = before_x = x;
        before_g = g;
    }
    for (int i = 0; i < ELEMENTS; ++i) {
        spring[i] = slope[i] - slope[i + 1];
    }
}

static double guide_force(double moved, int is_final) {
    double force = 0.0;
    for (int i = 0; i < ELEMENTS; ++i) {
        const double to = fmax(-slip[i], fmin(slip[i], stretch[i] + moved));
        force += spring[i] * to;
        if (is_final) {
            stretch[i] = to;
        }
    }
    return force;
}

static double position_of(const double *s) {
    return s[0] + s[2] + s[4];
}

static void rates(const double *s, double force, double *d) {
    const double pi = 3.14159265358979323846, net = force - viscous * (s[1] + s[3] + s[5]);
    d[0] = s[1];
    d[1] = body * net;
    for (int i = 0; i < 2; ++i) {
        const double w = 2.0 * pi * mode_frequency[i];
        d[2 + 2 * i] = s[3 + 2 * i];
        d[3 + 2 * i] = body * mode_gain[i] * net - 2.0 * mode_damping[i] * w * s[3 + 2 * i] - w * w * s[2 + 2 * i];
    }
}

static void runge_kutta(double *s, double force, double h) {
    double k[4][STATES], at[STATES];
    rates(s, force, k[0]);
    for (int stage = 1; stage < 4; ++stage) {
        for (int i = 0; i < STATES; ++i) {
            at[i] = s[i] + h * (stage < 3 ? 0.5 : 1.0) * k[stage - 1][i];
        }
        rates(at, force, k[stage]);
    }
    for (int i = 0; i < STATES; ++i) {
        s[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
}

int main(void) {
    double s[STATES] = {0}, thrust[DELAY + 1] = {0};
    const double h = sample_time / STEPS;
    axis_control_state controller;
    make_guide();
    axis_control_reset(&controller);
    for (int k = -1; k < SAMPLES; ++k) { /* at first the axis rests */
        const double measured = resolution * nearbyint(position_of(s) / resolution);
        for (int i = DELAY; i > 0; --i) {
            thrust[i] = thrust[i - 1];
        }
        thrust[0] = axis_control_step(&controller, measured, k < 0 ? 0.0 : target);
        if (k >= 0) {
            printf("%.17g\n", measured);
        }
        for (int step = 0; step < STEPS; ++step) {
            const double before = position_of(s), speed = s[1] + s[3] + s[5];
            runge_kutta(s, thrust[DELAY] - guide_force(0.5 * h * speed, 0), h);
            guide_force(position_of(s) - before, 1);
        }
    }
    return 0;
}
