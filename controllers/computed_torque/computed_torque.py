"""Computed torque: the model's inverse dynamics fed forward, and feedback on the tracking error."""

from __future__ import annotations

import warnings
from math import ceil

import numpy as np

from controllers.computed_torque.feedback import COMMAND, DRIVES, ESTIMATE, act
from controllers.computed_torque.feedback_design import (
    FeedbackSettings,
    design,
    feedback_margins,
    velocity_map,
)
from controllers.computed_torque.prediction import POSE, TIME, TORQUE, TWIST, predict
from controllers.interface import Array, Loop, Observation, Reference
from controllers.linear.linear_system import ROUNDING
from controllers.linear.margins import Margins
from controllers.linear.reference_window import reference_at
from youbot_env.errors import finite
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CONTACT, SPEED, WORLD
from youbot_env.physics.residual_maps import Places
from youbot_env.simulation.compiled import inverse_kernel
from youbot_env.simulation.generated_code import MOTION

LOAD_TOLERANCE = 1e-6
"""[N m] to which torques are found where friction depends on them."""


class ComputedTorque:
    """Wheel torques that the model demands for the reference, and feedback on the error.

    A command issued at t is held for ``loop.sample_time`` and acts from t + ``loop.delay`` +
    ``model.delay`` on. So the feed-forward is the mean demand over exactly that time: along the
    reference, and for effects that read them along the predicted pose, wheel angles and time. A
    drive's lag is inverted only for the reference, because that would amplify noise. The feedback
    is described in :mod:`controllers.computed_torque.feedback`.

    The reference must show its next ``preview_needed`` samples; missing ones are extrapolated with
    its last acceleration (a warning at the first call says so).

    Parameters
    ----------
    model : what the controller believes, with all its effects
    loop : times, limit and noise of the loop that it runs in
    bandwidth : [rad/s] of the feedback; None chooses by noise and delay
    settings : by what it chooses, and what the feedback believes

    Attributes
    ----------
    preview_needed : coming samples of the reference that the feed-forward reads
    design : the feedback's gains
    share : part of the wanted force that the last command exerts, 1 unless it saturates
    follows : whether pose and wheel angles are moved on along the reference: the model reads them

    Raises
    ------
    InputError
        If the bandwidth is not positive.
    """

    def __init__(
        self,
        model: Model,
        loop: Loop | None = None,
        bandwidth: float | None = None,
        settings: FeedbackSettings | None = None,
    ) -> None:
        self.model = model
        self.loop = loop or Loop(torque_limit=model.geometry.max_wheel_torque)
        if bandwidth is not None:
            bandwidth = finite("bandwidth [rad/s]", bandwidth, positive=True)
        self.design = design(model, self.loop, bandwidth, settings or FeedbackSettings())
        # In samples: a command is read ``_lead`` ahead of now, at the start of its hold.
        self._lead = float(self.design.constants["lead"][0])
        self.preview_needed = ceil(self._lead - ROUNDING) + 1
        # Only forces that read pose or wheel angles need them moved on along the reference.
        self.follows = bool(model.structure.at(WORLD)) or model.structure.depends_on_angle
        # ``body_twist`` is of wheels as the geometry has them; a model may know better.
        rolls_as_said = not (model.structure.at(CONTACT) or model.structure.at(SPEED))
        self._to_twist = None if rolls_as_said else velocity_map(model)
        self._kernel = inverse_kernel(model.structure, dynamics)
        # A copy: the adaptive controller writes into it, and the model is immutable.
        self._lengths, self._theta = model.lengths, model.theta.copy()
        self._has_maps = False  # the warm-up stands at the origin, where maps may know nothing
        self._warm_up()
        self._has_maps = bool(model.map_limits)

    def _warm_up(self) -> None:
        """Compile, or load compiled code, before a loop runs: its first call must not be slow."""
        still = np.zeros((self.preview_needed, 3))
        self.reset()
        observation = Observation(0.0, np.zeros(4), np.zeros(3))
        # Twice: the adaptive controller makes a row, which is compiled too, of two samples.
        for _ in range(2):
            self(observation, Reference(still[0], still[0], still, still))
        self.reset()

    def reset(self) -> None:
        """Forgets all estimates, commands on their way, and where the platform is."""
        self.share = 1.0
        self._begun = False
        self._inputs = np.zeros(17)
        self._nodes = np.zeros((self.design.past + 1 + self.preview_needed, 6))
        self._estimates = np.zeros(1 + self.design.past, ESTIMATE)
        self._queue = np.zeros(self.design.slots, COMMAND)
        self._drives = np.zeros(1, DRIVES)
        # Time, pose, wheel angles, and the twist that the pose was moved on with last.
        self._place = np.zeros(11)
        self._motion = np.zeros((3, len(MOTION)))
        self._torque, self._mean = np.zeros((3, 4)), np.zeros(4)
        self._forward = np.zeros(4)

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) fl, fr, bl, br [N m], within the limit.

        Uses the measured body twist; the pose where the model reads it (without one it is
        dead-reckoned from (0, 0, 0)); the acting torque where it is known, to notice drives that
        are off. NaN in an observation counts as not measured.

        Raises
        ------
        InputError
            If it is to go where a map of the residual in the model knows nothing.
        """
        coming, has_slopes = self._read(observation, reference)
        past, constants = self.design.past, self.design.constants
        predict(
            self._inputs,
            self._nodes,
            (past, coming, has_slopes, self._begun, self.follows),
            self._estimates,
            self._queue,
            self._drives,
            constants,
            self._place,
            self._motion,
        )
        if self._has_maps:
            twist, pose, angle = self._motion[:, :3], self._motion[:, 6:9], self._motion[:, 9:13]
            at = Places(twist, pose, angle, time=self._motion[:, 13])
            self.model.refuse_unseen(at, "the reference")
        self._kernel.held(
            self._motion,
            self.loop.sample_time,
            self._lengths,
            self._theta,
            LOAD_TOLERANCE,
            self._torque,
            self._mean,
            self._forward,
        )
        if not self._begun:
            self._begin()
        torque = np.empty(4)
        self.share = act(
            self._estimates,
            self._queue,
            self._drives,
            constants,
            self._nodes[past],
            self._motion,
            self._forward,
            self._mean,
            torque,
        )
        return torque

    def margins(self, plant: Model | None = None) -> Margins:
        """Gain and phase margins of the feedback at each axis' force, on its own model or another
        plant; see :func:`controllers.computed_torque.feedback_design.feedback_margins`."""
        return feedback_margins(self.design, plant or self.model, self.loop)

    def _begin(self) -> None:
        """Fill the queue for the time before the first command acts.

        The measured torque is taken to go on; without a measurement no torque acts.
        """
        acting = np.nan_to_num(self._inputs[TORQUE], posinf=0.0, neginf=0.0)
        to_acceleration = self.design.constants["to_acceleration"][0]
        demanded = to_acceleration @ self._mean
        exerted = to_acceleration @ acting - demanded
        queue, drives = self._queue, self._drives
        queue["demand"], queue["command"] = demanded, acting
        queue["correction"] = drives["correction"] = exerted
        queue["torque"] = drives["torque"] = acting
        # The past reference counts as planned, so its changes are no new errors.
        ends = np.empty((len(queue) + 1, 6))
        for age, at in enumerate(ends):
            reference_at(
                self._nodes, self.design.past + self._lead - age, self.loop.sample_time, at
            )
        # Row k of the queue was commanded k + 1 samples ago, for the hold between two of the ends.
        queue["planned"] = ends[:-1, :3] - ends[1:, :3]
        self._begun = True

    def _read(self, observation: Observation, reference: Reference) -> tuple[int, bool]:
        """Copy a call's inputs; how many coming samples there are, and whether with slopes."""
        inputs = self._inputs
        inputs[TIME] = observation.time
        inputs[TWIST] = observation.body_twist
        if self._to_twist is not None:
            inputs[TWIST] = observation.wheel_speed @ self._to_twist
        inputs[POSE] = np.nan if observation.pose is None else observation.pose
        inputs[TORQUE] = np.nan if observation.wheel_torque is None else observation.wheel_torque
        inputs[11:14], inputs[14:17] = reference.twist, reference.acceleration
        ahead, slopes = reference.preview, reference.preview_acceleration
        coming = 0 if ahead is None else min(len(ahead), self.preview_needed)
        if not self._begun and coming < self.preview_needed:
            warnings.warn(
                f"computed torque: the reference shows {coming} of the next {self.preview_needed} "
                "samples that the feed-forward needs; it goes on along the last acceleration",
                stacklevel=3,
            )
        if ahead is not None and coming:
            rows = slice(self.design.past + 1, self.design.past + 1 + coming)
            self._nodes[rows, :3] = ahead[:coming]
            if slopes is not None:
                self._nodes[rows, 3:] = slopes[:coming]
        return coming, slopes is not None
