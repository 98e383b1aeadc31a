"""The KUKA youBot's wheels, and what its drives can do, with the source of each number."""

WHEELS = ("fl", "fr", "bl", "br")
"""Wheel order everywhere: front left, front right, back left, back right."""

WHEEL_WORDS = {"fl": "front left", "fr": "front right", "bl": "back left", "br": "back right"}
"""Wheels in a sentence."""

TORQUE_CONSTANT = 0.0335
"""Motor torque per current [N m/A]: Maxon EC 45 flat, as in KUKA's youBot driver."""

NOMINAL_CURRENT = 2.32
"""Largest continuous motor current [A]: Maxon EC 45 flat data sheet."""

GEAR_RATIO = 9405 / 364
"""Motor turns per wheel turn, 25.84: KUKA's youBot driver configuration."""

# rpm times pi / 30 is rad/s.
MAX_MOTOR_SPEED = 5250 * 3.141592653589793 / 30
"""Nominal speed of the motor, 5250 rpm, in rad/s: youBot manual."""

MAX_WHEEL_TORQUE = TORQUE_CONSTANT * NOMINAL_CURRENT * GEAR_RATIO
"""Continuous torque at a wheel before gear losses, 2.01 N m."""

MAX_WHEEL_SPEED = MAX_MOTOR_SPEED / GEAR_RATIO
"""Speed of a wheel at the motor's nominal speed, 21.3 rad/s."""

MAX_BODY_SPEED = 0.8
"""Largest speed of the platform [m/s]: youBot manual."""

ENCODER_TICKS = 4000 * GEAR_RATIO
"""Encoder ticks per turn of a wheel, 103,352: 4000 per motor turn."""

STOCK_PROPORTIONAL, STOCK_INTEGRAL = 0.12, 0.30
"""Gains [N m s/rad, N m/rad] with which a wheel's speed loop follows as the stock one does."""
