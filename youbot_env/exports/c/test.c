/*@about@*/

/* Test driver: compares this code with what Python found on another machine, and prints how long
   its functions take here. Returns 0 if all is well.

       cc -std=c99 -O2 youbot_*.c -lm -o youbot_test && ./youbot_test                             */

/*@includes@*/
#include <math.h>
#include <stdio.h>
#include <time.h>

static const double TOLERANCE = 1e-11; /* of the largest component; compilers round differently */
/*@tolerances@*/

typedef struct sample {
    double state[YOUBOT_STATES];
    double torque[YOUBOT_JOINTS]; /* of the interface */
    double rates[YOUBOT_STATES];  /* Python's */
    youbot_motion motion;
    double torque_rate[YOUBOT_JOINTS];
    double command[YOUBOT_JOINTS]; /* Python's */
} sample;

static const sample SAMPLES[] = {
/*@samples@*/
};

enum { SAMPLE_COUNT = sizeof SAMPLES / sizeof SAMPLES[0], REPEATS = 20000 };

/* Largest difference as a share of the largest component; infinite if one is no number. */
static double difference(const double *found, const double *wanted, int count)
{
    double apart = 0.0, size = 1e-300;
    int i;

    for (i = 0; i < count; i++) {
        if (found[i] != found[i])
            return HUGE_VAL;
        apart = fmax(apart, fabs(found[i] - wanted[i]));
        size = fmax(size, fabs(wanted[i]));
    }
    return apart / size;
}

static int report(const char *what, double largest)
{
    const int is_good = largest <= TOLERANCE;

    printf("%s: largest relative difference from Python %.1e%s\n", what, largest,
           is_good ? "" : "  FAILED");
    return is_good ? 0 : 1;
}

static double microseconds_since(clock_t start, int count)
{
    return 1e6 * (double)(clock() - start) / CLOCKS_PER_SEC / count;
}

static int check_model(void)
{
    double rates[YOUBOT_STATES], command[YOUBOT_JOINTS];
    double forward = 0.0, inverse = 0.0, sum = 0.0;
    clock_t start;
    int i, failed;

    for (i = 0; i < SAMPLE_COUNT; i++) {
        const sample *s = &SAMPLES[i];
        youbot_forward_dynamics(&youbot_identified, s->state, s->torque, rates);
        forward = fmax(forward, difference(rates, s->rates, YOUBOT_STATES));
        youbot_inverse_dynamics(&youbot_identified, &s->motion, s->torque_rate, command);
        inverse = fmax(inverse, difference(command, s->command, YOUBOT_JOINTS));
    }
    failed = report("forward dynamics", forward) + report("inverse dynamics", inverse);
    start = clock();
    for (i = 0; i < REPEATS; i++) {
        youbot_forward_dynamics(&youbot_identified, SAMPLES[i % SAMPLE_COUNT].state,
                                SAMPLES[i % SAMPLE_COUNT].torque, rates);
        sum += rates[0]; /* so that no compiler leaves the loop out */
    }
    printf("forward dynamics: %.3f us\n", microseconds_since(start, REPEATS));
    start = clock();
    for (i = 0; i < REPEATS; i++) {
        youbot_inverse_dynamics(&youbot_identified, &SAMPLES[i % SAMPLE_COUNT].motion, NULL,
                                command);
        sum += command[0];
    }
    printf("inverse dynamics: %.3f us\n", microseconds_since(start, REPEATS));
    /* A sum that is no number was reported above. */
    return failed + (sum != sum ? 1 : 0);
}

/*@more_checks@*/
int main(void)
{
    int failed = 0;

    failed += check_model();
/*@more_calls@*/
    puts(failed ? "FAILED" : "passed");
    return failed ? 1 : 0;
}
