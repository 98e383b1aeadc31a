/*@about@*/
#ifndef YOUBOT_MODEL_H
#define YOUBOT_MODEL_H

#ifdef __cplusplus
extern "C" {
#endif

/* Sizes. */
enum {
    YOUBOT_AXES = /*@axes@*/, /* of the velocity: /*@axis_names@*/ */
    YOUBOT_JOINTS = /*@joints@*/, /* in this order everywhere: /*@joint_names@*/ */
    YOUBOT_POSITIONS = /*@positions@*/, /* of the pose */
    YOUBOT_STATES = /*@states@*/ /* components of the state, see youbot_state_index */
};

/* Where the components of a state stand. */
enum youbot_state_index {
/*@state_index@*/
};

/* Parameters, SI units, in the form in which the equations are linear in them: of the centre of
   mass (aX, aY) it holds the moments m_aX = m aX and m_aY = m aY. */
typedef struct youbot_parameters {
/*@parameter_fields@*/
} youbot_parameters;

/* The parameters of the model that this file was made from:
/*@stated_values@*/ */
extern const youbot_parameters youbot_identified;

/* What a motion is at one instant. */
typedef struct youbot_motion {
    double velocity[YOUBOT_AXES];     /*@velocity_note@*/
    double acceleration[YOUBOT_AXES]; /* time derivative of the velocity's components */
    double pose[YOUBOT_POSITIONS];    /*@pose_note@*/
    double joint_angle[YOUBOT_JOINTS]; /* [rad]; only cogging reads them */
    double time;                      /* [s]; only effects that change with time read it */
} youbot_motion;

/* Forward dynamics: time derivative of the state under the torques of the interface (the commands
   to the drives). Channels, drives and losses are part of it. Where there is a delay, `torque` is
   what was commanded youbot_torque_delay() earlier: youbot_plant_step keeps the commands. */
void youbot_forward_dynamics(const youbot_parameters *p, const double state[YOUBOT_STATES],
                             const double torque[YOUBOT_JOINTS], double rates[YOUBOT_STATES]);

/* Torques that must act at the joints [N m], of all that drive the motion those of least norm.
   Losses that grow with the load make them depend on themselves: they are sought from the values
   that `torque` comes with until they move by no more than `tolerance` [N m] in sum. */
void youbot_joint_torque(const youbot_parameters *p, const youbot_motion *motion,
                         double tolerance, double torque[YOUBOT_JOINTS]);

/* Torques of the interface [N m] behind which `torque` [N m] acts at the joints and changes at
   `torque_rate` [N m/s]: drives and channels taken back. They belong to an instant
   youbot_torque_delay() before that of the motion, of which velocity and time are read. */
void youbot_interface_torque(const youbot_parameters *p, const youbot_motion *motion,
                             const double torque[YOUBOT_JOINTS],
                             const double torque_rate[YOUBOT_JOINTS],
                             double command[YOUBOT_JOINTS]);

/* Inverse dynamics: the torques of the interface [N m] that drive a motion, the feed-forward.
   `torque_rate` [N m/s] is the rate of the torques that act, read by drives alone; NULL is 0. */
void youbot_inverse_dynamics(const youbot_parameters *p, const youbot_motion *motion,
                             const double torque_rate[YOUBOT_JOINTS],
                             double command[YOUBOT_JOINTS]);

/* By how much [s] a commanded torque acts late. */
double youbot_torque_delay(const youbot_parameters *p);

/* Move a state on by `duration` [s] under torques that are held, in `steps` Runge-Kutta steps. */
void youbot_advance(const youbot_parameters *p, double state[YOUBOT_STATES],
                    const double torque[YOUBOT_JOINTS], double duration, int steps);

/* A simulated platform: its state and the commands that are on their way to its drives. */

#ifndef YOUBOT_DELAY_SLOTS
#define YOUBOT_DELAY_SLOTS /*@delay_slots@*/ /* commands on their way, held 1 ms or longer each */
#endif

/* Runge-Kutta steps that the model needs for a step of /*@period@*/ s. */
#define YOUBOT_PLANT_STEPS /*@plant_steps@*/

typedef struct youbot_held_torque {
    double torque[YOUBOT_JOINTS]; /* [N m] */
    double duration;              /* [s] for which it acts */
} youbot_held_torque;

typedef struct youbot_plant {
    youbot_parameters parameters;
    double state[YOUBOT_STATES];
    youbot_held_torque queue[YOUBOT_DELAY_SLOTS]; /* a ring: the oldest is at `first` */
    int first, count;
    double delay; /* [s] */
} youbot_plant;

/* Put a plant at rest at the origin. `extra_delay` [s] is what the bus and the controller's
   computation add to the model's own delay. */
void youbot_plant_reset(youbot_plant *plant, const youbot_parameters *p, double extra_delay);

/* Move on by `duration` [s] under commands that are held. Returns 0, or -1 if YOUBOT_DELAY_SLOTS
   is too small for the delay at steps this short (nothing is moved then). */
int youbot_plant_step(youbot_plant *plant, const double torque[YOUBOT_JOINTS], double duration,
                      int steps);

#ifdef __cplusplus
}
#endif

#endif
