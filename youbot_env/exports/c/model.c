/*@about@*/
#include "youbot_model.h"

#include <math.h>
#include <stddef.h>

const youbot_parameters youbot_identified = {
/*@parameter_values@*/
};

/*@helpers@*/
/*@forward_dynamics@*/

/* Torques that the motion demands while given torques act: first what does not depend on these. */
/*@demand@*/

/*@interface_torque@*/

/*@torque_delay@*/

/* Most rounds for torques that depend on themselves: each reduces the error by the share that the
   losses take, at most 0.9. Without such losses the first round is exact. */
enum { ROUNDS = /*@rounds@*/ };

/* [N m] Sum of torques above which a first guess is replaced by 0, as is NaN. */
static const double SANE = /*@sane@*/;

void youbot_joint_torque(const youbot_parameters *p, const youbot_motion *motion,
                         double tolerance, double torque[YOUBOT_JOINTS])
{
    double fixed[FIXED], demanded[YOUBOT_JOINTS];
    double size = 0.0, moved;
    int joint, k;

    for (joint = 0; joint < YOUBOT_JOINTS; joint++)
        size += fabs(torque[joint]);
    /* Written so that NaN is replaced too. */
    if (!(size < SANE))
        for (joint = 0; joint < YOUBOT_JOINTS; joint++)
            torque[joint] = 0.0;
    fixed_demand(p, motion, fixed);
    for (k = 0; k < ROUNDS; k++) {
        demanded_torque(fixed, torque, demanded);
        moved = 0.0;
        for (joint = 0; joint < YOUBOT_JOINTS; joint++) {
            moved += fabs(demanded[joint] - torque[joint]);
            torque[joint] = demanded[joint];
        }
        if (moved <= tolerance)
            break;
    }
}

void youbot_inverse_dynamics(const youbot_parameters *p, const youbot_motion *motion,
                             const double torque_rate[YOUBOT_JOINTS],
                             const double torque_second_rate[YOUBOT_JOINTS],
                             double command[YOUBOT_JOINTS])
{
    /* [N m] Rounding moves torques of some N m by less. */
    const double tolerance = 1e-14;
    const double steady[YOUBOT_JOINTS] = {0.0};
    double torque[YOUBOT_JOINTS] = {0.0};

    youbot_joint_torque(p, motion, tolerance, torque);
    youbot_interface_torque(p, motion, torque, torque_rate ? torque_rate : steady,
                            torque_second_rate ? torque_second_rate : steady, command);
}

void youbot_advance(const youbot_parameters *p, double state[YOUBOT_STATES],
                    const double torque[YOUBOT_JOINTS], double duration, int steps)
{
    double a[YOUBOT_STATES], b[YOUBOT_STATES], c[YOUBOT_STATES], d[YOUBOT_STATES];
    double at[YOUBOT_STATES];
    const double dt = duration / steps;
    int i, k;

    /* The classical Runge-Kutta method of fourth order. */
    for (k = 0; k < steps; k++) {
        youbot_forward_dynamics(p, state, torque, a);
        for (i = 0; i < YOUBOT_STATES; i++)
            at[i] = state[i] + 0.5 * dt * a[i];
        youbot_forward_dynamics(p, at, torque, b);
        for (i = 0; i < YOUBOT_STATES; i++)
            at[i] = state[i] + 0.5 * dt * b[i];
        youbot_forward_dynamics(p, at, torque, c);
        for (i = 0; i < YOUBOT_STATES; i++)
            at[i] = state[i] + dt * c[i];
        youbot_forward_dynamics(p, at, torque, d);
        for (i = 0; i < YOUBOT_STATES; i++)
            state[i] += dt / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
    }
}

void youbot_plant_reset(youbot_plant *plant, const youbot_parameters *p, double extra_delay)
{
    int i;

    plant->parameters = *p;
    for (i = 0; i < YOUBOT_STATES; i++)
        plant->state[i] = 0.0;
    plant->delay = youbot_torque_delay(p) + extra_delay;
    plant->first = 0;
    plant->count = 0;
    /* Nothing acts until the first command arrives. */
    if (plant->delay > 0.0) {
        for (i = 0; i < YOUBOT_JOINTS; i++)
            plant->queue[0].torque[i] = 0.0;
        plant->queue[0].duration = plant->delay;
        plant->count = 1;
    }
}

int youbot_plant_step(youbot_plant *plant, const double torque[YOUBOT_JOINTS], double duration,
                      int steps)
{
    /* A piece of time that is shorter is rounding, not a piece of its own. */
    const double rounding = 1e-9 * duration;
    double left = duration, taken;
    youbot_held_torque *oldest, *newest;
    int i;

    if (plant->count == 0) {
        youbot_advance(&plant->parameters, plant->state, torque, duration, steps);
        return 0;
    }
    if (plant->count == YOUBOT_DELAY_SLOTS)
        return -1;
    newest = &plant->queue[(plant->first + plant->count) % YOUBOT_DELAY_SLOTS];
    for (i = 0; i < YOUBOT_JOINTS; i++)
        newest->torque[i] = torque[i];
    newest->duration = duration;
    plant->count++;
    /* What was commanded for as long as the step lasts is `duration` or longer: the delay itself is
       on its way, too. */
    while (left > 0.0 && plant->count > 0) {
        oldest = &plant->queue[plant->first];
        taken = oldest->duration > left - rounding ? left : oldest->duration;
        if (!(oldest->duration <= rounding && rounding < left))
            youbot_advance(&plant->parameters, plant->state, oldest->torque, taken,
                           (int)ceil(steps * taken / duration));
        else
            taken = 0.0;
        if (oldest->duration > left + rounding) {
            oldest->duration -= left;
        } else {
            plant->first = (plant->first + 1) % YOUBOT_DELAY_SLOTS;
            plant->count--;
        }
        left -= taken;
    }
    return 0;
}
