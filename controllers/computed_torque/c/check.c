static int check_controller(void)
{
    static youbot_controller controller;
    static youbot_plant plant;
    youbot_observation seen;
    youbot_reference wanted;
    youbot_node at;
    double command[YOUBOT_JOINTS] = {0.0}, angle[YOUBOT_JOINTS] = {0.0}, speed[YOUBOT_JOINTS];
    double error[YOUBOT_AXES] = {0.0}, size[YOUBOT_AXES] = {0.0}, found[YOUBOT_AXES];
    double largest = 0.0;
    clock_t start;
    int k, row, axis, wheel, limited = 0, failed = 0;

    youbot_controller_init(&controller, NULL, NULL);
    youbot_plant_reset(&plant, &youbot_identified, youbot_example_delay);
    wanted.preview_count = YOUBOT_PREVIEW;
    wanted.has_preview_acceleration = 1;
    for (k = 0; k < YOUBOT_EXAMPLE_STEPS; k++) {
        seen.time = k * YOUBOT_PERIOD;
        youbot_example_speeds(plant.state, angle, speed);
        youbot_body_velocity(speed, seen.velocity);
        for (wheel = 0; wheel < YOUBOT_JOINTS; wheel++)
            seen.torque[wheel] = command[wheel];
        for (axis = 0; axis < YOUBOT_POSITIONS; axis++)
            seen.pose[axis] = NAN;
        at = youbot_example_reference(seen.time);
        for (axis = 0; axis < YOUBOT_AXES; axis++) {
            wanted.velocity[axis] = at.velocity[axis];
            wanted.acceleration[axis] = at.acceleration[axis];
            error[axis] += (plant.state[axis] - at.velocity[axis]) *
                           (plant.state[axis] - at.velocity[axis]);
            size[axis] += at.velocity[axis] * at.velocity[axis];
        }
        for (row = 0; row < YOUBOT_PREVIEW; row++) {
            at = youbot_example_reference((k + 1 + row) * YOUBOT_PERIOD);
            for (axis = 0; axis < YOUBOT_AXES; axis++) {
                wanted.preview[row][axis] = at.velocity[axis];
                wanted.preview_acceleration[row][axis] = at.acceleration[axis];
            }
        }
        limited += youbot_controller_update(&controller, &seen, &wanted, command) < 1.0 - 1e-9;
        failed |= youbot_plant_step(&plant, command, YOUBOT_PERIOD, YOUBOT_PLANT_STEPS) != 0;
    }
    printf("closed loop, error of VX, VY, W:");
    for (axis = 0; axis < YOUBOT_AXES; axis++) {
        found[axis] = sqrt(error[axis] / size[axis]);
        printf(" %.4f %%", 100.0 * found[axis]);
        largest = fmax(largest, fabs(found[axis] - youbot_example_error[axis]));
        failed |= found[axis] != found[axis];
    }
    failed |= largest > EXAMPLE_TOLERANCE;
    printf(", by %.1e from Python%s\n", largest, failed ? "  FAILED" : "");
    youbot_example_tell_limit(limited);
    start = clock();
    for (k = 0; k < REPEATS; k++)
        youbot_controller_update(&controller, &seen, &wanted, command);
    printf("controller: %.3f us\n", microseconds_since(start, REPEATS));
    return failed;
}
