/*@about@*/
#ifndef YOUBOT_CONTROLLER_HPP
#define YOUBOT_CONTROLLER_HPP

#include <array>
#include <cstddef>
#include <limits>

#include "youbot_controller.h"

/// The computed-torque controller in the shape of a ros2_control controller: reset() belongs into
/// on_activate, update() into update. No ROS header is needed, nothing is allocated or thrown.
namespace youbot_control
{

constexpr std::size_t kAxes = YOUBOT_AXES;          ///< VX, VY, W
constexpr std::size_t kWheels = YOUBOT_JOINTS;      ///< fl, fr, bl, br
constexpr std::size_t kPreview = YOUBOT_PREVIEW;    ///< coming samples that are read
constexpr double kPeriod = YOUBOT_PERIOD;           ///< [s] between two updates
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// What the state interfaces show. kUnknown stands for what is not measured.
struct State
{
  double time{kUnknown};                                    ///< [s]
  std::array<double, kWheels> wheel_velocity{};             ///< [rad/s], rolling forward positive
  std::array<double, 3> pose{kUnknown, kUnknown, kUnknown}; ///< x, y, yaw [m, m, rad]
  /// [N m] that act; without this interface the last command is taken.
  std::array<double, kWheels> effort{kUnknown, kUnknown, kUnknown, kUnknown};
};

/// What is wanted now, and at the next periods where that is known.
struct Reference
{
  std::array<double, kAxes> velocity{};     ///< VX, VY, W [m/s, m/s, rad/s] of the body
  std::array<double, kAxes> acceleration{}; ///< [m/s^2, m/s^2, rad/s^2]
  std::size_t preview_count{0};             ///< samples of `preview` that are filled
  bool has_preview_acceleration{false};
  std::array<std::array<double, kAxes>, kPreview> preview{};
  std::array<std::array<double, kAxes>, kPreview> preview_acceleration{};
};

/// [N m] for the effort command interfaces.
using Efforts = std::array<double, kWheels>;

class ComputedTorqueController
{
public:
  ComputedTorqueController() noexcept { youbot_controller_init(&controller_, nullptr, nullptr); }

  /// With other parameters or gains than those that were exported.
  ComputedTorqueController(
    const youbot_parameters & parameters, const youbot_design & design) noexcept
  {
    youbot_controller_init(&controller_, &parameters, &design);
  }

  /// As before the first update.
  void reset() noexcept
  {
    youbot_controller_reset(&controller_);
    efforts_.fill(0.0);
    has_commanded_ = false;
  }

  /// One period: the efforts to command, within the limit.
  Efforts update(const State & state, const Reference & reference) noexcept
  {
    youbot_observation seen{};
    youbot_reference wanted{};
    seen.time = state.time;
    youbot_body_velocity(state.wheel_velocity.data(), seen.velocity);
    for (std::size_t i = 0; i < state.pose.size(); ++i) {
      seen.pose[i] = state.pose[i];
    }
    for (std::size_t i = 0; i < kWheels; ++i) {
      const bool is_measured = state.effort[i] == state.effort[i];
      seen.torque[i] = is_measured || !has_commanded_ ? state.effort[i] : efforts_[i];
    }
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
      wanted.velocity[axis] = reference.velocity[axis];
      wanted.acceleration[axis] = reference.acceleration[axis];
      for (std::size_t row = 0; row < kPreview; ++row) {
        wanted.preview[row][axis] = reference.preview[row][axis];
        wanted.preview_acceleration[row][axis] = reference.preview_acceleration[row][axis];
      }
    }
    const std::size_t count =
      reference.preview_count < kPreview ? reference.preview_count : kPreview;
    wanted.preview_count = static_cast<int>(count);
    wanted.has_preview_acceleration = reference.has_preview_acceleration ? 1 : 0;
    youbot_controller_update(&controller_, &seen, &wanted, efforts_.data());
    has_commanded_ = true;
    return efforts_;
  }

  /// Share of the wanted force that the last efforts exert: 1 unless they are at the limit.
  double share() const noexcept { return controller_.share; }

  /// The estimated error of VX, VY, W, measured minus wanted.
  std::array<double, kAxes> error() const noexcept
  {
    const auto & error = controller_.estimates[0].error;
    return {error[0], error[1], error[2]};
  }

private:
  youbot_controller controller_{};
  Efforts efforts_{};
  bool has_commanded_{false};
};

}  // namespace youbot_control

#endif
