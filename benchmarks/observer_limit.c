/* The arithmetic of `kernels.observer.observe` for one mode and a sensor of displacement or velocity, written plainly
 * in C: the yardstick for its speed. It has none of the guards (missing samples, unsettled start), knows one force at
 * most, the cubic spring, and has that inlined, where the kernel calls any term of the catalogue by its address.
 *   cc -O3 -march=native observer_limit.c -o observer_limit && ./observer_limit FILE
 * FILE holds doubles: Phi (4), begin, end, K, H (2 each), tool (4), spread at both Gauss points before and after the
 * sample at the end of a step is seen (8 each), back (2), step, w, coefficient, recording.
 * Prints nanoseconds per sample and the sum of the squared errors, without and with the force. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef struct {
    double transition[4], begin[2], end[2], gain[2], output[2], tool[4], before[8], after[8], back[2];
    double step, omega, coefficient;
} Observer;

static double spring(const Observer *o, double x) { return o->coefficient * o->omega * o->omega * x * x * x; }

/* Force over a step as a straight line, its values at both ends. */
static void over_step(const Observer *o, double x0, double v0, double x1, double v1, const double *spread,
                      double *early, double *late) {
    const double node[2] = {0.5 - 0.28867513459481287, 0.5 + 0.28867513459481287};
    double mean = 0.0, slope = 0.0, square = 0.0;
    for (int i = 0; i < 2; i++) {
        double s = node[i], r = 1.0 - s, dx = 1.4142135623730951 * spread[4 * i + i];
        double at = r * r * (1.0 + 2.0 * s) * x0 + s * s * (1.0 + 2.0 * r) * x1 + o->step * s * r * (r * v0 - s * v1);
        double force = 0.5 * spring(o, at + dx) + 0.5 * spring(o, at - dx);
        mean += force;
        slope += force * (s - 0.5);
        square += (s - 0.5) * (s - 0.5);
    }
    mean /= 2.0;
    slope /= square;
    *early = mean - 0.5 * slope;
    *late = mean + 0.5 * slope;
}

static double observe(const Observer *o, const double *y, double *x0, double *v0, double *x1, double *v1, long n,
                      int known) {
    double s0 = 0.0, s1 = 0.0, early = 0.0, late = 0.0, x = 0.0, v = 0.0, sum = 0.0;
    for (long k = 0; k < n; k++) {
        double e = y[k] - o->output[0] * s0 - o->output[1] * s1;
        sum += e * e;
        if (known && k > 0) { /* with the sample seen, the force on the way to it is known better */
            double begins, ends, t0 = s0 + o->gain[0] * e, t1 = s1 + o->gain[1] * e;
            over_step(o, x + o->back[0] * e, v + o->back[1] * e, o->tool[0] * t0 + o->tool[1] * t1,
                      o->tool[2] * t0 + o->tool[3] * t1, o->after, &begins, &ends);
            double n0 = o->begin[0] * (begins - early) + o->end[0] * (ends - late);
            double n1 = o->begin[1] * (begins - early) + o->end[1] * (ends - late);
            s0 += n0;
            s1 += n1;
            e -= o->output[0] * n0 + o->output[1] * n1;
            late = ends;
        }
        s0 += o->gain[0] * e;
        s1 += o->gain[1] * e;
        x = o->tool[0] * s0 + o->tool[1] * s1;
        v = o->tool[2] * s0 + o->tool[3] * s1;
        double a0 = o->transition[0] * s0 + o->transition[1] * s1, a1 = o->transition[2] * s0 + o->transition[3] * s1;
        early = late;
        for (int attempt = 0; attempt < (known ? 2 : 0); attempt++) {
            double r0 = a0 + o->begin[0] * early + o->end[0] * late, r1 = a1 + o->begin[1] * early + o->end[1] * late;
            over_step(o, x, v, o->tool[0] * r0 + o->tool[1] * r1, o->tool[2] * r0 + o->tool[3] * r1, o->before, &early,
                      &late);
        }
        s0 = a0 + o->begin[0] * early + o->end[0] * late;
        s1 = a1 + o->begin[1] * early + o->end[1] * late;
        x0[k] = x;
        v0[k] = v;
        x1[k] = o->tool[0] * s0 + o->tool[1] * s1;
        v1[k] = o->tool[2] * s0 + o->tool[3] * s1;
    }
    return sum;
}

int main(int argc, char **argv) {
    Observer o;
    FILE *f = argc > 1 ? fopen(argv[1], "rb") : NULL;
    if (!f || fread(&o, sizeof o, 1, f) != 1) return 2;
    fseek(f, 0, SEEK_END);
    long n = (ftell(f) - (long)sizeof o) / (long)sizeof(double);
    double *y = malloc(5 * n * sizeof(double));
    fseek(f, sizeof o, SEEK_SET);
    if (!y || fread(y, sizeof(double), n, f) != (size_t)n) return 2;
    for (int known = 0; known < 2; known++) {
        double best = 1e300, sum = 0.0;
        for (int round = 0; round < 5; round++) {
            struct timespec a, b;
            clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
            sum = observe(&o, y, y + n, y + 2 * n, y + 3 * n, y + 4 * n, n, known);
            clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
            double took = (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
            if (took < best) best = took;
        }
        printf("%.6g %.12g\n", 1e9 * best / n, sum);
    }
    return 0;
}
