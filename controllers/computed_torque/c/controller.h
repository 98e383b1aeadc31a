/*@about@*/
#ifndef YOUBOT_CONTROLLER_H
#define YOUBOT_CONTROLLER_H

#include "youbot_model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Computed torque: the model's inverse dynamics fed forward, and feedback on the tracking error by
   an estimator that knows delay, hold and lag of the loop.

   A command that is returned at t is held for YOUBOT_PERIOD and acts from t + lead periods on. So
   the feed-forward is the mean demand over exactly that time, and the feedback drives the error to
   zero that is predicted for it. Call youbot_controller_update once a period; it allocates nothing,
   does no system call and takes the same time at each call (/*@timing@*/).

   Axes are VX, VY, W of the body [m/s, m/s, rad/s], X forward, Y left; wheels fl, fr, bl, br, with
   positive speed and torque rolling the robot forward. */

/* Made for a loop with
/*@loop@*/ */
#define YOUBOT_PERIOD /*@period@*/ /* [s] between two updates */

enum {
    YOUBOT_QUEUE = /*@queue@*/, /* commands kept: those on their way, and two for a part of a period */
    YOUBOT_PAST = /*@past@*/, /* past samples kept: the measurement's instant lies among them */
    YOUBOT_PREVIEW = /*@preview@*/ /* coming samples of the reference that the feed-forward reads */
};

/* What is measured. NAN stands for what is not. */
typedef struct youbot_observation {
    double time;                  /* [s] */
    double velocity[YOUBOT_AXES]; /* of the body, by the wheels: youbot_body_velocity */
    double pose[YOUBOT_POSITIONS]; /* x, y, yaw in the world [m, m, rad]; read by models that need
                                     it, dead-reckoned without */
    double torque[YOUBOT_JOINTS]; /* [N m] that act at the wheels, to notice drives that are off;
                                     the last command does as well */
} youbot_observation;

/* What is wanted: now, and at the next periods. Less preview than YOUBOT_PREVIEW is extrapolated
   with the last acceleration, which costs accuracy. */
typedef struct youbot_reference {
    double velocity[YOUBOT_AXES];
    double acceleration[YOUBOT_AXES]; /* time derivative of the velocity's components */
    int preview_count;                /* rows of `preview` that are filled, from the next period on */
    int has_preview_acceleration;     /* 0: they are found by differences */
    double preview[YOUBOT_PREVIEW][YOUBOT_AXES];
    double preview_acceleration[YOUBOT_PREVIEW][YOUBOT_AXES];
} youbot_reference;

/* Numbers of the design. An error e becomes transition e + input_gain (a + d) after a period under
   an acceleration a and a disturbance d, and with `_part` after the part of a period that the delay
   has beside its whole ones. Rows of three are VX, VY, W. */
typedef struct youbot_design {
    double transition[YOUBOT_AXES];      /* [1] */
    double input_gain[YOUBOT_AXES];      /* [s] */
    double transition_part[YOUBOT_AXES]; /* [1] */
    double input_gain_part[YOUBOT_AXES]; /* [s] */
    /* Estimator: by how much an error found moves the estimates of error and disturbance. */
    double error_correction[YOUBOT_AXES];       /* [1] */
    double disturbance_correction[YOUBOT_AXES]; /* [1/s] */
    /* Regulator: acceleration per error, and per acceleration that the drives exert. */
    double error_feedback[YOUBOT_AXES];  /* [1/s] */
    double drive_feedback[YOUBOT_AXES];  /* [1] */
    double max_disturbance[YOUBOT_AXES]; /* [m/s^2] that is believed */
    double max_first_error[YOUBOT_AXES]; /* [m/s] that may be noise */
    double period;      /* [s] */
    double age;         /* [s] of a measured velocity */
    double lead;        /* [periods] from now to the instant at which a command acts */
    int whole_samples;  /* of the lead */
    double newer_share; /* of a period in which the newer of two commands acts */
    /* Of what the drives exert beside the command's: what stays after a period, what acts during it
       on average, and what stays after the part of a period. All 0 without a lag. */
    double lag_stays, lag_mean, lag_stays_part;
    double slope[YOUBOT_JOINTS]; /* true torque per commanded one */
    double torque_limit;         /* [N m] of a command */
    double torque_tolerance;     /* [N m] beyond which a measured torque is believed */
    double to_acceleration[YOUBOT_AXES][YOUBOT_JOINTS]; /* [m/s^2 per N m] */
    double to_torque[YOUBOT_JOINTS][YOUBOT_AXES];       /* the least-norm way back */
    double jacobian[YOUBOT_JOINTS][YOUBOT_AXES];        /* [rad/s per m/s] wheels per body */
    double internal[YOUBOT_JOINTS];                     /* [N m] torques that exert no force */
} youbot_design;

extern const youbot_design youbot_designed;

/* Error of the body's velocity, measured minus wanted, and the acceleration that disturbs it. */
typedef struct youbot_estimate {
    double error[YOUBOT_AXES];       /* [m/s] */
    double disturbance[YOUBOT_AXES]; /* [m/s^2] */
} youbot_estimate;

/* A command that was sent, as it acts for one period. */
typedef struct youbot_sent {
    double correction[YOUBOT_AXES]; /* [m/s^2] that it exerts beside the feed-forward's */
    double torque[YOUBOT_JOINTS];   /* [N m] true ones, behind the channel */
    double demand[YOUBOT_AXES];     /* [m/s^2] that the feed-forward stands for */
    double command[YOUBOT_JOINTS];  /* [N m] as it was sent */
    double planned[YOUBOT_AXES];    /* [m/s] change of the reference that it was planned for */
} youbot_sent;

/* What the drives exert behind delay and lag: now, and on average over the last period. */
typedef struct youbot_drives {
    double correction[YOUBOT_AXES];
    double torque[YOUBOT_JOINTS];
    double mean_correction[YOUBOT_AXES];
    double mean_torque[YOUBOT_JOINTS];
    double mean_demand[YOUBOT_AXES];
    double mean_planned[YOUBOT_AXES];
} youbot_drives;

/* The reference at one instant. */
typedef struct youbot_node {
    double velocity[YOUBOT_AXES];
    double acceleration[YOUBOT_AXES];
} youbot_node;

/* All that the controller remembers. Nothing in it is a pointer: it may be copied. */
typedef struct youbot_controller {
    youbot_parameters parameters;
    youbot_design design;
    int has_begun;
    double share; /* of the wanted force that the last command exerts; 1 unless it saturates */
    youbot_node nodes[YOUBOT_PAST + 1 + YOUBOT_PREVIEW]; /* the reference; YOUBOT_PAST is now */
    youbot_estimate estimates[1 + YOUBOT_PAST];          /* newest first */
    youbot_sent queue[YOUBOT_QUEUE];                     /* newest first */
    youbot_drives drives;
    double time;                       /* [s] */
    double pose[YOUBOT_POSITIONS];     /* estimated */
    double angle[YOUBOT_JOINTS];       /* [rad] estimated */
    double velocity[YOUBOT_AXES];      /* with which pose and angles were moved on last */
    double demanded[3][YOUBOT_JOINTS]; /* [N m] at the start, middle and end of the hold */
} youbot_controller;

/* Put a controller at its start. NULL takes the identified parameters and the design for them. */
void youbot_controller_init(youbot_controller *c, const youbot_parameters *p,
                            const youbot_design *design);

/* Forget all estimates, commands on their way, and where the platform is. */
void youbot_controller_reset(youbot_controller *c);

/* One period: fills the commands [N m], within the limit. Returns the share of the wanted force
   that they exert. */
double youbot_controller_update(youbot_controller *c, const youbot_observation *seen,
                                const youbot_reference *wanted, double command[YOUBOT_JOINTS]);

/* Least-squares velocity of the body by the speeds of its wheels [rad/s]. */
void youbot_body_velocity(const double wheel_speed[YOUBOT_JOINTS], double velocity[YOUBOT_AXES]);

#ifdef __cplusplus
}
#endif

#endif
