/*@about@*/

// The controller behind its C++ class drives the plant for some seconds; prints the errors.
//
//   cc -std=c99 -O2 -c youbot_model.c youbot_controller.c
//   c++ -std=c++17 -O2 youbot_example.cpp youbot_model.o youbot_controller.o -lm -o example
//   ./example

#include <array>
#include <cmath>
#include <cstdio>

#include "youbot_controller.hpp"
#include "youbot_example.h"

int main()
{
  using namespace youbot_control;

  ComputedTorqueController controller;
  youbot_plant plant;
  State state;
  Reference reference;
  std::array<double, kWheels> angle{};
  std::array<double, kAxes> error{}, size{};
  int limited = 0;

  controller.reset();
  youbot_plant_reset(&plant, &youbot_identified, youbot_example_delay);
  for (int k = 0; k < YOUBOT_EXAMPLE_STEPS; ++k) {
    state.time = k * kPeriod;
    youbot_example_speeds(plant.state, angle.data(), state.wheel_velocity.data());
    const youbot_node now = youbot_example_reference(state.time);
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
      reference.velocity[axis] = now.velocity[axis];
      reference.acceleration[axis] = now.acceleration[axis];
      error[axis] += std::pow(plant.state[axis] - now.velocity[axis], 2);
      size[axis] += std::pow(now.velocity[axis], 2);
    }
    reference.preview_count = kPreview;
    reference.has_preview_acceleration = true;
    for (std::size_t row = 0; row < kPreview; ++row) {
      const youbot_node coming =
        youbot_example_reference((k + 1 + static_cast<int>(row)) * kPeriod);
      for (std::size_t axis = 0; axis < kAxes; ++axis) {
        reference.preview[row][axis] = coming.velocity[axis];
        reference.preview_acceleration[row][axis] = coming.acceleration[axis];
      }
    }
    const Efforts efforts = controller.update(state, reference);
    limited += controller.share() < 1.0 - 1e-9;
    if (youbot_plant_step(&plant, efforts.data(), kPeriod, YOUBOT_PLANT_STEPS) != 0) {
      std::puts("the plant's delay line is too short");
      return 1;
    }
  }
  std::printf("error of VX, VY, W:");
  for (std::size_t axis = 0; axis < kAxes; ++axis) {
    std::printf(" %.6f %%", 100.0 * std::sqrt(error[axis] / size[axis]));
  }
  std::printf("\n");
  youbot_example_tell_limit(limited);
  return 0;
}
