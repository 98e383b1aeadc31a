/*@about@*/
#ifndef YOUBOT_EXAMPLE_H
#define YOUBOT_EXAMPLE_H

#include <math.h>
#include <stdio.h>

#include "youbot_controller.h"

/* The reference of the test driver and of the example: a sum of sines on each axis, which starts
   and ends at rest. */

enum { YOUBOT_EXAMPLE_STEPS = /*@steps@*/ }; /* control periods, the one at the start among them */

static const double youbot_example_duration = /*@duration@*/; /* [s] */
static const double youbot_example_ramp = /*@ramp@*/;     /* [s] at both ends */

/* Delay of the loop [s]: bus and computation. */
static const double youbot_example_delay = /*@delay@*/;

/* Error of VX, VY, W that Python's controller leaves on Python's plant, root mean square over that
   of the reference. */
static const double youbot_example_error[YOUBOT_AXES] = /*@errors@*/;

typedef struct youbot_tone {
    int axis;
    double frequency; /* [rad/s] */
    double amplitude; /* [m/s] or [rad/s] */
    double phase;     /* [rad] */
} youbot_tone;

static const youbot_tone youbot_example_tones[] = {
/*@tones@*/
};

static youbot_node youbot_example_reference(double time)
{
    const int count = (int)(sizeof youbot_example_tones / sizeof youbot_example_tones[0]);
    const double duration = youbot_example_duration, ramp = youbot_example_ramp;
    double u = fmin(time, duration - time) / ramp, rise, slope;
    youbot_node found = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    double change[YOUBOT_AXES] = {0.0, 0.0, 0.0};
    int k, axis;

    /* A window of the fifth degree at both ends, and its derivative. */
    u = fmin(fmax(u, 0.0), 1.0);
    rise = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
    slope = 30.0 * u * u * (1.0 - u) * (1.0 - u) * (time < duration / 2 ? 1.0 : -1.0) / ramp;
    for (k = 0; k < count; k++) {
        const youbot_tone *tone = &youbot_example_tones[k];
        const double angle = tone->frequency * time + tone->phase;
        found.velocity[tone->axis] += tone->amplitude * sin(angle);
        change[tone->axis] += tone->frequency * tone->amplitude * cos(angle);
    }
    for (axis = 0; axis < YOUBOT_AXES; axis++) {
        found.acceleration[axis] = slope * found.velocity[axis] + rise * change[axis];
        found.velocity[axis] = rise * found.velocity[axis];
    }
    return found;
}

/* Mean speeds of the wheels over the last period, as encoder counts give them; where the controller
   was made for speeds without an age, those of the instant. `angle` keeps the last angles. */
static void youbot_example_speeds(const double state[YOUBOT_STATES], double angle[YOUBOT_JOINTS],
                                  double speed[YOUBOT_JOINTS])
{
    const youbot_design *d = &youbot_designed;
    int axis, wheel;

    for (wheel = 0; wheel < YOUBOT_JOINTS; wheel++) {
        const double turned = state[YOUBOT_STATE_ANGLE_FL + wheel];
        speed[wheel] = 0.0;
        for (axis = 0; axis < YOUBOT_AXES; axis++)
            speed[wheel] += d->jacobian[wheel][axis] * state[axis];
        if (d->age > 0.0)
            speed[wheel] = (turned - angle[wheel]) / d->period;
        angle[wheel] = turned;
    }
}

/* Says that the limit, not the code, makes the errors, where it cut the force in some periods. */
static void youbot_example_tell_limit(int limited)
{
    if (limited > 0)
        printf("in %.1f %% of the periods the torque limit of %g N m cuts the force that the "
               "reference needs: these errors are its work, and a robot has them too\n",
               100.0 * limited / YOUBOT_EXAMPLE_STEPS, youbot_designed.torque_limit);
}

#endif
