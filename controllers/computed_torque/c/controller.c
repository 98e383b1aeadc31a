/*@about@*/
#include "youbot_controller.h"

#include <math.h>
#include <string.h>

enum { AXES = YOUBOT_AXES, WHEELS = YOUBOT_JOINTS, NOW = YOUBOT_PAST };
enum { NODES = YOUBOT_PAST + 1 + YOUBOT_PREVIEW };

/* Whether forces depend on pose or wheel angles, so that these are moved on along the reference. */
enum { FOLLOWS = /*@follows@*/ };

/* [N m] to which torques are found where friction depends on them. */
static const double LOAD_TOLERANCE = /*@load_tolerance@*/;

/* Velocity of the body per wheel speed, least squares. */
static const double TO_VELOCITY[YOUBOT_AXES][YOUBOT_JOINTS] = /*@to_velocity@*/;

const youbot_design youbot_designed = {
/*@design@*/
};

static double between(double value, double least, double most)
{
    return fmin(fmax(value, least), most);
}

static int is_number(double value)
{
    return fabs(value) < HUGE_VAL;
}

/* --- the reference --------------------------------------------------------------------------- */

/* The node before a place, which is counted in periods from the first node. */
static int node_before(double place)
{
    const int index = (int)place;

    return index < 0 ? 0 : index > NODES - 2 ? NODES - 2 : index;
}

/* Velocity of the reference at a place: a cubic Hermite polynomial between two nodes, constant
   acceleration outside. */
static void velocity_at(const youbot_controller *c, double place, double velocity[YOUBOT_AXES])
{
    const double period = c->design.period;
    const int index = node_before(place);
    const youbot_node *before = &c->nodes[index], *after = before + 1;
    const double u = place - index;
    double a0, a1, rise;
    int axis;

    if (u == 0.0) {
        memcpy(velocity, before->velocity, sizeof before->velocity);
        return;
    }
    for (axis = 0; axis < AXES; axis++) {
        if (u > 1.0) {
            velocity[axis] = after->velocity[axis] +
                             (place - (NODES - 1)) * period * after->acceleration[axis];
        } else if (u < 0.0) {
            velocity[axis] = before->velocity[axis] + place * period * before->acceleration[axis];
        } else {
            a0 = period * before->acceleration[axis];
            a1 = period * after->acceleration[axis];
            rise = after->velocity[axis] - before->velocity[axis];
            /* Coefficients of u^2 and u^3 that meet both velocities and both accelerations. */
            velocity[axis] = before->velocity[axis] +
                             u * (a0 + u * (3.0 * rise - 2.0 * a0 - a1 + u * (a0 + a1 - 2.0 * rise)));
        }
    }
}

/* Velocity and acceleration of the reference at a place. */
static youbot_node reference_at(const youbot_controller *c, double place)
{
    const double period = c->design.period;
    const int index = node_before(place);
    const youbot_node *before = &c->nodes[index], *after = before + 1;
    const double u = place - index;
    double a0, a1, rise;
    youbot_node found;
    int axis;

    velocity_at(c, place, found.velocity);
    for (axis = 0; axis < AXES; axis++) {
        a0 = period * before->acceleration[axis];
        a1 = period * after->acceleration[axis];
        rise = after->velocity[axis] - before->velocity[axis];
        found.acceleration[axis] = u > 1.0   ? after->acceleration[axis]
                                   : u < 0.0 ? before->acceleration[axis]
                                             : (a0 + u * (2.0 * (3.0 * rise - 2.0 * a0 - a1) +
                                                          3.0 * u * (a0 + a1 - 2.0 * rise))) /
                                                   period;
    }
    return found;
}

static int node_is_number(const youbot_node *node)
{
    int axis;

    for (axis = 0; axis < AXES; axis++)
        if (!is_number(node->velocity[axis]) || !is_number(node->acceleration[axis]))
            return 0;
    return 1;
}

/* What is wanted now; what is no number goes on with the last acceleration. */
static youbot_node wanted_now(const youbot_controller *c, const youbot_reference *wanted)
{
    const youbot_node *last = &c->nodes[NOW];
    youbot_node now;
    int axis;

    for (axis = 0; axis < AXES; axis++) {
        now.velocity[axis] =
            is_number(wanted->velocity[axis])
                ? wanted->velocity[axis]
                : last->velocity[axis] + c->design.period * last->acceleration[axis];
        now.acceleration[axis] = is_number(wanted->acceleration[axis]) ? wanted->acceleration[axis]
                                                                       : last->acceleration[axis];
    }
    return now;
}

/* Put the coming samples behind the present one. Returns how many there are: they end before the
   first that is no number. */
static int take_preview(youbot_controller *c, const youbot_reference *wanted)
{
    const int given = wanted->preview_count;
    const int count = given < 0 ? 0 : given > YOUBOT_PREVIEW ? YOUBOT_PREVIEW : given;
    int row, axis;

    for (row = 0; row < count; row++)
        for (axis = 0; axis < AXES; axis++) {
            c->nodes[NOW + 1 + row].velocity[axis] = wanted->preview[row][axis];
            if (wanted->has_preview_acceleration)
                c->nodes[NOW + 1 + row].acceleration[axis] =
                    wanted->preview_acceleration[row][axis];
        }
    for (row = 0; row < count; row++)
        if (!node_is_number(&c->nodes[NOW + 1 + row]))
            return row;
    return count;
}

/* Move the window of the reference on by one period. */
static void take_sample(youbot_controller *c, const youbot_node *now, int coming, int has_slopes)
{
    const int end = NOW + coming;
    const double period = c->design.period;
    youbot_node *nodes = c->nodes;
    double slope;
    int row, axis;

    /* Only the past is shifted: the coming samples are at their new places already. */
    for (row = 0; row < NOW; row++)
        nodes[row] = nodes[row + 1];
    nodes[NOW] = *now;
    if (!has_slopes)
        for (row = NOW + 1; row <= end; row++)
            for (axis = 0; axis < AXES; axis++) {
                if (row < end) {
                    /* Central difference: exact where the reference is a parabola. */
                    slope = 0.5 * (nodes[row + 1].velocity[axis] - nodes[row - 1].velocity[axis]);
                } else {
                    /* The last known sample has one neighbour: a parabola through it and the
                       acceleration before. */
                    slope = 2.0 * (nodes[row].velocity[axis] - nodes[row - 1].velocity[axis]);
                    slope -= period * nodes[row - 1].acceleration[axis];
                }
                nodes[row].acceleration[axis] = slope / period;
            }
    for (row = end + 1; row < NODES; row++)
        for (axis = 0; axis < AXES; axis++) {
            slope = nodes[end].acceleration[axis];
            nodes[row].velocity[axis] = nodes[end].velocity[axis] + (row - end) * period * slope;
            nodes[row].acceleration[axis] = slope;
        }
}

/* Fill the time before the first sample, as if its acceleration had been constant before. */
static void extend_to_past(youbot_controller *c)
{
    double slope;
    int row, axis;

    for (row = 0; row < NOW; row++)
        for (axis = 0; axis < AXES; axis++) {
            slope = c->nodes[NOW].acceleration[axis];
            c->nodes[row].velocity[axis] =
                c->nodes[NOW].velocity[axis] - (NOW - row) * c->design.period * slope;
            c->nodes[row].acceleration[axis] = slope;
        }
}

/* --- the estimator --------------------------------------------------------------------------- */

/* What a drive exerts on average during a period, and at its end in `now`. */
static double lagged(const youbot_design *d, double mixed, double newer, double before, double *now)
{
    const double rest = before - mixed;

    /* Without a lag the newer command alone acts at the end. */
    if (!(d->lag_stays > 0.0)) {
        *now = newer;
        return mixed;
    }
    *now = mixed + rest * d->lag_stays;
    return mixed + rest * d->lag_mean;
}

/* One period of the drives, under the two commands that acted during it. */
static void move_drives(youbot_controller *c)
{
    const youbot_design *d = &c->design;
    const youbot_sent *newer = &c->queue[d->whole_samples];
    const youbot_sent *older = &c->queue[d->whole_samples + 1];
    const double share = d->newer_share;
    youbot_drives *acting = &c->drives;
    double mixed;
    int axis, wheel;

    for (axis = 0; axis < AXES; axis++) {
        mixed = share * newer->correction[axis] + (1.0 - share) * older->correction[axis];
        acting->mean_correction[axis] = lagged(d, mixed, newer->correction[axis],
                                               acting->correction[axis], &acting->correction[axis]);
        acting->mean_demand[axis] =
            share * newer->demand[axis] + (1.0 - share) * older->demand[axis];
        acting->mean_planned[axis] =
            share * newer->planned[axis] + (1.0 - share) * older->planned[axis];
    }
    for (wheel = 0; wheel < WHEELS; wheel++) {
        mixed = share * newer->torque[wheel] + (1.0 - share) * older->torque[wheel];
        acting->mean_torque[wheel] = lagged(d, mixed, newer->torque[wheel], acting->torque[wheel],
                                            &acting->torque[wheel]);
    }
}

/* Whether the wheels' torque is known and neither what the commands make of it nor the last of
   them. */
static int contradicts(const youbot_controller *c, const double measured[YOUBOT_JOINTS])
{
    double expected = 0.0, commanded = 0.0;
    int wheel;

    for (wheel = 0; wheel < WHEELS; wheel++) {
        if (!is_number(measured[wheel]))
            return 0;
        expected = fmax(expected, fabs(measured[wheel] - c->drives.torque[wheel]));
        commanded = fmax(commanded, fabs(measured[wheel] - c->queue[0].command[wheel]));
    }
    return expected > c->design.torque_tolerance && commanded > c->design.torque_tolerance;
}

/* Drives that do not obey: what they exert is taken from the measurement. */
static void believe(youbot_controller *c, const double measured[YOUBOT_JOINTS])
{
    youbot_drives *acting = &c->drives;
    double value;
    int axis, wheel;

    for (axis = 0; axis < AXES; axis++) {
        value = -acting->mean_demand[axis];
        for (wheel = 0; wheel < WHEELS; wheel++)
            value += c->design.to_acceleration[axis][wheel] * measured[wheel];
        acting->mean_correction[axis] = acting->correction[axis] = value;
    }
    for (wheel = 0; wheel < WHEELS; wheel++)
        acting->mean_torque[wheel] = acting->torque[wheel] = measured[wheel];
}

/* One period of the estimator. `error` is the measured velocity minus the reference of the instant
   at which it was measured; `change` is that of the reference since the last period. */
static void estimate(youbot_controller *c, const double change[YOUBOT_AXES],
                     const double error[YOUBOT_AXES], const double torque[YOUBOT_JOINTS])
{
    const youbot_design *d = &c->design;
    const double behind = d->age / d->period;
    const int whole = (int)behind;
    const double part = behind - whole;
    youbot_estimate *now = &c->estimates[0];
    double disturbance, prior, newer, older, found;
    int row, axis;

    for (row = YOUBOT_PAST; row > 0; row--)
        c->estimates[row] = c->estimates[row - 1];
    move_drives(c);
    if (contradicts(c, torque))
        believe(c, torque);
    for (axis = 0; axis < AXES; axis++) {
        disturbance = now->disturbance[axis];
        prior = d->transition[axis] * now->error[axis];
        prior += d->input_gain[axis] * (c->drives.mean_correction[axis] + disturbance);
        prior += c->drives.mean_planned[axis] - change[axis];
        /* The measurement's instant lies between two samples of the past. */
        newer = whole == 0 ? prior : c->estimates[whole].error[axis];
        older = c->estimates[1 + whole].error[axis];
        found = error[axis] - ((1.0 - part) * newer + part * older);
        /* Not measured: the prediction stands alone. */
        if (!is_number(found))
            found = 0.0;
        now->error[axis] = prior + d->error_correction[axis] * found;
        disturbance += d->disturbance_correction[axis] * found;
        now->disturbance[axis] =
            between(disturbance, -d->max_disturbance[axis], d->max_disturbance[axis]);
    }
}

/* --- where the platform is, and will be ------------------------------------------------------ */

/* Move time, pose and wheel angles on to now by the estimated velocity, and by what is measured. */
static void locate(youbot_controller *c, const youbot_observation *seen)
{
    const double period = c->design.period;
    double velocity[YOUBOT_AXES], mean[YOUBOT_AXES], yaw, cosine, sine;
    int i, axis, wheel;

    for (axis = 0; axis < AXES; axis++)
        velocity[axis] = c->nodes[NOW].velocity[axis] + c->estimates[0].error[axis];
    if (c->has_begun) {
        /* Trapezoidal rule for the velocity, midpoint rule for the yaw. */
        for (axis = 0; axis < AXES; axis++)
            mean[axis] = 0.5 * (velocity[axis] + c->velocity[axis]);
        yaw = c->pose[2] + 0.5 * period * mean[2];
        cosine = cos(yaw);
        sine = sin(yaw);
        c->time += period;
        c->pose[0] += period * (cosine * mean[0] - sine * mean[1]);
        c->pose[1] += period * (sine * mean[0] + cosine * mean[1]);
        c->pose[2] += period * mean[2];
        for (wheel = 0; wheel < WHEELS; wheel++)
            for (axis = 0; axis < AXES; axis++)
                c->angle[wheel] += period * c->design.jacobian[wheel][axis] * mean[axis];
    }
    for (axis = 0; axis < AXES; axis++)
        c->velocity[axis] = velocity[axis];
    if (is_number(seen->time))
        c->time = seen->time;
    for (i = 0; i < YOUBOT_POSITIONS; i++)
        if (is_number(seen->pose[i]))
            c->pose[i] = seen->pose[i];
}

/* Turn a direction by an angle. A long delay has many short turns, and series of 8 terms are exact
   to the last digit for these, and faster than sin and cos. */
static void turn(double by, double *cosine, double *sine)
{
    const double b2 = by * by, c = *cosine, s = *sine;
    double cosine_by, sine_by;

    if (fabs(by) < 0.03) {
        sine_by = by * (1.0 + b2 * (-1.0 / 6 + b2 * (1.0 / 120 - b2 * (1.0 / 5040))));
        cosine_by = 1.0 + b2 * (-0.5 + b2 * (1.0 / 24 + b2 * (-1.0 / 720 + b2 * (1.0 / 40320))));
    } else {
        sine_by = sin(by);
        cosine_by = cos(by);
    }
    *cosine = c * cosine_by - s * sine_by;
    *sine = s * cosine_by + c * sine_by;
}

/* Move a pose and wheel angles on along the reference from one place to another: Simpson's rule
   for each piece of at most one period, yaw at the middle from the middle velocity. */
static void follow(const youbot_controller *c, double start, double end,
                   double pose[YOUBOT_POSITIONS], double angle[YOUBOT_JOINTS])
{
    double first[YOUBOT_AXES], middle[YOUBOT_AXES], last[YOUBOT_AXES];
    double travelled[YOUBOT_AXES] = {0.0};
    double stop, span, sixth, half, whole, cosine = cos(pose[2]), sine = sin(pose[2]), x, y;
    int axis, wheel;

    velocity_at(c, start, first);
    while (start < end - 1e-9) {
        stop = fmin(end, floor(start + 1e-9) + 1.0);
        span = (stop - start) * c->design.period;
        sixth = span * (1.0 / 6);
        velocity_at(c, start + 0.5 * (stop - start), middle);
        velocity_at(c, stop, last);
        for (axis = 0; axis < AXES; axis++)
            travelled[axis] += sixth * (first[axis] + 4.0 * middle[axis] + last[axis]);
        x = cosine * first[0] - sine * first[1];
        y = sine * first[0] + cosine * first[1];
        /* To a half of the span, by the parabola through the three. */
        half = 0.25 * sixth * (5.0 * first[2] + 8.0 * middle[2] - last[2]);
        turn(half, &cosine, &sine);
        x += 4.0 * (cosine * middle[0] - sine * middle[1]);
        y += 4.0 * (sine * middle[0] + cosine * middle[1]);
        whole = sixth * (first[2] + 4.0 * middle[2] + last[2]);
        turn(whole - half, &cosine, &sine);
        pose[2] += whole;
        x += cosine * last[0] - sine * last[1];
        y += sine * last[0] + cosine * last[1];
        pose[0] += sixth * x;
        pose[1] += sixth * y;
        /* The end of this piece is the start of the next. */
        memcpy(first, last, sizeof first);
        start = stop;
    }
    for (wheel = 0; wheel < WHEELS; wheel++)
        for (axis = 0; axis < AXES; axis++)
            angle[wheel] += c->design.jacobian[wheel][axis] * travelled[axis];
}

/* The motion at the start, the middle and the end of the hold in which the command will act. */
static void look_ahead(const youbot_controller *c, youbot_motion motion[3])
{
    double pose[YOUBOT_POSITIONS], angle[YOUBOT_JOINTS], here = NOW, there;
    youbot_node node;
    int k;

    memcpy(pose, c->pose, sizeof pose);
    memcpy(angle, c->angle, sizeof angle);
    for (k = 0; k < 3; k++) {
        there = NOW + c->design.lead + 0.5 * k;
        node = reference_at(c, there);
        if (FOLLOWS) {
            follow(c, here, there, pose, angle);
            here = there;
        }
        memcpy(motion[k].velocity, node.velocity, sizeof node.velocity);
        memcpy(motion[k].acceleration, node.acceleration, sizeof node.acceleration);
        memcpy(motion[k].pose, pose, sizeof pose);
        memcpy(motion[k].joint_angle, angle, sizeof angle);
        motion[k].time = c->time + (c->design.lead + 0.5 * k) * c->design.period;
    }
}

/* --- the command ----------------------------------------------------------------------------- */

/* Torques of the interface that, held for a period, do best what the motions demand: they make the
   mean of the acting torques (Simpson's rule), their mean rates and second rates. */
static void feed_forward(youbot_controller *c, const youbot_motion motion[3],
                         double mean[YOUBOT_JOINTS], double forward[YOUBOT_JOINTS])
{
    const double hold = c->design.period;
    double rate[YOUBOT_JOINTS], second[YOUBOT_JOINTS];
    int k, wheel;

    for (k = 0; k < 3; k++)
        youbot_joint_torque(&c->parameters, &motion[k], LOAD_TOLERANCE, c->demanded[k]);
    for (wheel = 0; wheel < WHEELS; wheel++) {
        mean[wheel] =
            (c->demanded[0][wheel] + 4.0 * c->demanded[1][wheel] + c->demanded[2][wheel]) / 6.0;
        rate[wheel] = (c->demanded[2][wheel] - c->demanded[0][wheel]) / hold;
        second[wheel] = 4.0 *
                        (c->demanded[0][wheel] - 2.0 * c->demanded[1][wheel] +
                         c->demanded[2][wheel]) /
                        (hold * hold);
    }
    youbot_interface_torque(&c->parameters, &motion[1], mean, rate, second, forward);
}

/* The acceleration to command: it cancels the disturbance and drives the error to zero that is
   predicted for the instant at which the command acts, with the commands that are on their way.
   `change` is that of the reference until then, as it is known now. */
static void correct(const youbot_controller *c, const double change[YOUBOT_AXES],
                    double out[YOUBOT_AXES])
{
    const youbot_design *d = &c->design;
    const double share = d->newer_share;
    double error, disturbance, torque, surprise, mixed, acts;
    int row, axis;

    for (axis = 0; axis < AXES; axis++) {
        error = c->estimates[0].error[axis];
        disturbance = c->estimates[0].disturbance[axis];
        torque = c->drives.correction[axis];
        /* Change of the reference that was not planned: no command on its way accounts for it. */
        surprise = -change[axis];
        for (row = d->whole_samples; row > 0; row--) {
            const youbot_sent *newer = &c->queue[row - 1], *older = &c->queue[row];
            mixed = share * newer->correction[axis] + (1.0 - share) * older->correction[axis];
            acts = mixed + (torque - mixed) * d->lag_mean;
            torque = mixed + (torque - mixed) * d->lag_stays;
            error = d->transition[axis] * error + d->input_gain[axis] * (acts + disturbance);
            surprise += share * newer->planned[axis];
            surprise += (1.0 - share) * older->planned[axis];
        }
        if (share < 1.0) {
            mixed = c->queue[0].correction[axis];
            /* Mean of the lag over the part of a period, by its two ends; 0 without a lag. */
            acts = mixed;
            if (d->lag_stays > 0.0)
                acts += (torque - mixed) * (0.5 + 0.5 * d->lag_stays_part);
            torque = mixed + (torque - mixed) * d->lag_stays_part;
            error = d->transition_part[axis] * error;
            error += d->input_gain_part[axis] * (acts + disturbance);
            surprise += (1.0 - share) * c->queue[0].planned[axis];
        }
        error += surprise;
        /* A steady drive exerts -disturbance, so only the difference from it is fed back. */
        out[axis] = -disturbance - d->error_feedback[axis] * error;
        out[axis] -= d->drive_feedback[axis] * (torque + disturbance);
    }
}

/* Torques within +-`limit` that exert a share of the force of `torque`, which is returned: 1 where
   a shift along `internal`, torques that exert no force, is enough.

   In w = torque / internal the shift adds one number to all four, so the limits leave an interval
   for it. Where it is empty, the two values of w that are furthest apart, relative to the sum of
   their limits, give the share that is left. */
static double within_limits(const double torque[YOUBOT_JOINTS], const double limit[YOUBOT_JOINTS],
                            const double internal[YOUBOT_JOINTS], double out[YOUBOT_JOINTS])
{
    double low = -HUGE_VAL, high = HUGE_VAL, share = 1.0, apart, most, value, shift;
    int i, j;

    for (i = 0; i < WHEELS; i++)
        for (j = 0; j < WHEELS; j++) {
            apart = torque[i] / internal[i] - torque[j] / internal[j];
            most = limit[i] / fabs(internal[i]) + limit[j] / fabs(internal[j]);
            if (share * apart > most)
                share = most / apart;
        }
    for (i = 0; i < WHEELS; i++) {
        value = share * torque[i] / internal[i];
        most = limit[i] / fabs(internal[i]);
        low = fmax(low, -most - value);
        high = fmin(high, most - value);
    }
    /* The interval is one point; rounding may have made its lower end the larger one. */
    if (share < 1.0)
        low = high = 0.5 * (low + high);
    /* The shift in the interval that is nearest to 0, which keeps the norm least. */
    shift = fmin(fmax(0.0, low), high);
    for (i = 0; i < WHEELS; i++)
        /* Cut once more, because rounding may exceed the limit by a last digit. */
        out[i] = between(share * torque[i] + internal[i] * shift, -limit[i], limit[i]);
    return share;
}

/* Commands of feed-forward and the acceleration `wanted`, within the limit, and what they will
   exert. `planned` is the change of the reference during the hold. */
static double exert(youbot_controller *c, const double wanted[YOUBOT_AXES],
                    const double forward[YOUBOT_JOINTS], const double mean[YOUBOT_JOINTS],
                    const double planned[YOUBOT_AXES], double command[YOUBOT_JOINTS])
{
    const youbot_design *d = &c->design;
    youbot_sent *sent = &c->queue[0];
    double torque[YOUBOT_JOINTS], limits[YOUBOT_JOINTS], kept[YOUBOT_JOINTS], share, exerted, demand;
    int row, axis, wheel;

    for (wheel = 0; wheel < WHEELS; wheel++) {
        torque[wheel] = d->slope[wheel] * forward[wheel];
        /* The limit is one of commands; here torques are those behind the channel. */
        limits[wheel] = d->torque_limit * fabs(d->slope[wheel]);
        for (axis = 0; axis < AXES; axis++)
            torque[wheel] += d->to_torque[wheel][axis] * wanted[axis];
    }
    share = within_limits(torque, limits, d->internal, kept);
    for (row = YOUBOT_QUEUE - 1; row > 0; row--)
        c->queue[row] = c->queue[row - 1];
    for (axis = 0; axis < AXES; axis++) {
        exerted = 0.0;
        demand = 0.0;
        for (wheel = 0; wheel < WHEELS; wheel++) {
            exerted += d->to_acceleration[axis][wheel] *
                       (kept[wheel] - d->slope[wheel] * forward[wheel]);
            demand += d->to_acceleration[axis][wheel] * mean[wheel];
        }
        sent->correction[axis] = exerted;
        sent->demand[axis] = demand;
        sent->planned[axis] = planned[axis];
    }
    for (wheel = 0; wheel < WHEELS; wheel++) {
        sent->torque[wheel] = kept[wheel];
        command[wheel] = kept[wheel] / d->slope[wheel];
        sent->command[wheel] = command[wheel];
    }
    return share;
}

/* Fill the queue for the time before the first command acts: the measured torque is taken to go on;
   without a measurement no torque acts. */
static void begin(youbot_controller *c, const double measured[YOUBOT_JOINTS],
                  const double mean[YOUBOT_JOINTS])
{
    const youbot_design *d = &c->design;
    youbot_sent first;
    youbot_node newer, older;
    double acting;
    int row, axis, wheel;

    for (axis = 0; axis < AXES; axis++)
        first.demand[axis] = first.correction[axis] = 0.0;
    for (wheel = 0; wheel < WHEELS; wheel++) {
        acting = is_number(measured[wheel]) ? measured[wheel] : 0.0;
        first.command[wheel] = first.torque[wheel] = c->drives.torque[wheel] = acting;
        for (axis = 0; axis < AXES; axis++) {
            first.demand[axis] += d->to_acceleration[axis][wheel] * mean[wheel];
            first.correction[axis] += d->to_acceleration[axis][wheel] * acting;
        }
    }
    for (axis = 0; axis < AXES; axis++) {
        first.correction[axis] -= first.demand[axis];
        c->drives.correction[axis] = first.correction[axis];
    }
    /* The past reference counts as planned, so its changes are no new errors. */
    newer = reference_at(c, NOW + d->lead);
    for (row = 0; row < YOUBOT_QUEUE; row++) {
        older = reference_at(c, NOW + d->lead - (row + 1));
        for (axis = 0; axis < AXES; axis++)
            first.planned[axis] = newer.velocity[axis] - older.velocity[axis];
        c->queue[row] = first;
        newer = older;
    }
    c->has_begun = 1;
}

/* --- the interface --------------------------------------------------------------------------- */

void youbot_controller_init(youbot_controller *c, const youbot_parameters *p,
                            const youbot_design *design)
{
    c->parameters = p ? *p : youbot_identified;
    c->design = design ? *design : youbot_designed;
    youbot_controller_reset(c);
}

void youbot_controller_reset(youbot_controller *c)
{
    const youbot_parameters parameters = c->parameters;
    const youbot_design design = c->design;

    memset(c, 0, sizeof *c); /* all doubles 0.0 */
    c->parameters = parameters;
    c->design = design;
    c->share = 1.0;
}

double youbot_controller_update(youbot_controller *c, const youbot_observation *seen,
                                const youbot_reference *wanted, double command[YOUBOT_JOINTS])
{
    const youbot_node now = wanted_now(c, wanted);
    double error[YOUBOT_AXES], change[YOUBOT_AXES], planned[YOUBOT_AXES], acceleration[YOUBOT_AXES];
    double mean[YOUBOT_JOINTS], forward[YOUBOT_JOINTS];
    youbot_motion motion[3];
    youbot_node then;
    int axis;

    take_sample(c, &now, take_preview(c, wanted), wanted->has_preview_acceleration);
    if (!c->has_begun)
        extend_to_past(c);
    /* The measurement is `age` old, so it is compared with the reference of that instant. */
    then = reference_at(c, NOW - c->design.age / c->design.period);
    for (axis = 0; axis < AXES; axis++) {
        error[axis] = seen->velocity[axis] - then.velocity[axis];
        change[axis] = c->nodes[NOW].velocity[axis] - c->nodes[NOW - 1].velocity[axis];
    }
    estimate(c, change, error, seen->torque);
    if (!c->has_begun)
        /* Far beyond noise the platform moves already: the estimator starts at the measured error,
           for it would take its first miss for a disturbance. */
        for (axis = 0; axis < AXES; axis++)
            if (fabs(error[axis]) > c->design.max_first_error[axis] && is_number(error[axis])) {
                c->estimates[0].error[axis] = error[axis];
                c->estimates[0].disturbance[axis] = 0.0;
            }
    locate(c, seen);
    look_ahead(c, motion);
    feed_forward(c, motion, mean, forward);
    if (!c->has_begun)
        begin(c, seen->torque, mean);
    for (axis = 0; axis < AXES; axis++) {
        change[axis] = motion[0].velocity[axis] - c->nodes[NOW].velocity[axis];
        planned[axis] = motion[2].velocity[axis] - motion[0].velocity[axis];
    }
    correct(c, change, acceleration);
    c->share = exert(c, acceleration, forward, mean, planned, command);
    return c->share;
}

void youbot_body_velocity(const double wheel_speed[YOUBOT_JOINTS], double velocity[YOUBOT_AXES])
{
    int axis, wheel;

    for (axis = 0; axis < AXES; axis++) {
        velocity[axis] = 0.0;
        for (wheel = 0; wheel < WHEELS; wheel++)
            velocity[axis] += TO_VELOCITY[axis][wheel] * wheel_speed[wheel];
    }
}
