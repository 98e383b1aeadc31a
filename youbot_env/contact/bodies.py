"""One platform in MuJoCo, and the drives between a command and its wheels."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from youbot_env.contact.mjcf import mjcf
from youbot_env.contact.settings import Contact, EngineSettings
from youbot_env.errors import optional_library
from youbot_env.model.model import Model
from youbot_env.physics.geometry import SIGN_X, WHEELS
from youbot_env.physics.mecanum import STATE
from youbot_env.simulation.platforms import DRIVES, POSE, TWIST, WHEEL_ANGLE, drive_delay

Array = NDArray[np.float64]

CLOCK = len(STATE) - 1
YAW = POSE.start + 2
"""Where time and heading stand in a state."""


class Bodies:
    """One platform in the engine, and the drives between command and wheel.

    Attributes
    ----------
    acting : (4,) torques [N m] that act at the wheels now
    """

    def __init__(self, model: Model, contact: Contact) -> None:
        self._model, self._timestep = model, contact.timestep
        values = model.values
        self._lag = values.get("actuator_lag.time_constant", 0.0)
        has_load = values.get("payload_change.mass", 0.0) > 0.0
        self._load_time = values["payload_change.time"] if has_load else math.inf
        engine = _engine()
        self._bare = engine.MjModel.from_xml_string(mjcf(model, contact))
        self._loaded = self._bare
        if has_load:
            document = mjcf(model, contact, loaded=True)
            self._loaded = engine.MjModel.from_xml_string(document)
        joints = [self._bare.joint(name) for name in WHEELS]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        self._begin()

    def _begin(self) -> None:
        self._now, self._data = self._bare, _engine().MjData(self._bare)
        self._time, self._lost = 0.0, False
        self._line = drive_delay(self._model)
        self.acting: Array = np.zeros(4)

    def twin(self) -> Bodies:
        """Another platform with the same model. The compiled MuJoCo models are shared."""
        # Not by __init__, which would compile the documents again.
        other = object.__new__(Bodies)
        other.__dict__.update(self.__dict__)
        other._begin()
        return other

    # Starting ---------------------------------------------------------------------------------

    def place(self, state: Array) -> None:
        """Stand at a state (S,), let the rollers settle, then roll without slip."""
        self._begin()
        self._time = float(state[CLOCK])
        if self._time >= self._load_time:
            self._now = self._loaded
        if len(state) > len(STATE):
            self.acting = state[DRIVES].copy()
        data, yaw = self._data, state[YAW]
        data.qpos[:2] = state[POSE][:2]
        # MuJoCo's quaternions are (w, x, y, z).
        data.qpos[3:7] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        data.qpos[self._q] = state[WHEEL_ANGLE]
        self._settle()
        self._set_off(state[TWIST], yaw)

    def _settle(self) -> None:
        data = self._data
        self._now.opt.timestep = self._timestep
        for _ in range(round(EngineSettings.settling_time / self._timestep)):
            _engine().mj_step(self._now, data)
            # Only height, roll and pitch may move: the place is given, also on a slope.
            upright = data.qvel[2:5].copy()
            data.qvel[:] = 0.0
            data.qvel[2:5] = upright

    def _set_off(self, twist: Array, yaw: float) -> None:
        (vx, vy, w), g, data = twist, self._model.geometry, self._data
        data.qvel[:] = 0.0
        # A free joint's linear velocity is in the world frame, its angular one in the body frame.
        data.qvel[0] = math.cos(yaw) * vx - math.sin(yaw) * vy
        data.qvel[1] = math.sin(yaw) * vx + math.cos(yaw) * vy
        data.qvel[5] = w
        rate = g.wheel_speeds(twist)
        # Degrees of freedom: 6 of the platform, then for each wheel its own and its rollers'.
        rollers = (self._now.nv - 6) // 4 - 1
        for i, first in enumerate(self._v):
            data.qvel[first] = rate[i]
            # All rollers of a wheel, so that the next one touches the floor without slip too.
            spin = -(vy + w * SIGN_X[i] * g.h) * g.slants[i] / g.r
            data.qvel[first + 1 : first + 1 + rollers] = spin
        _engine().mj_forward(self._now, data)

    # Moving -----------------------------------------------------------------------------------

    def advance(self, command: Array, duration: float) -> None:
        """Hold a command (4,) for ``duration`` [s]."""
        within = np.abs(command).max() < EngineSettings.max_torque  # False for NaN too
        self._lost = self._lost or not within
        if self._lost:
            return
        # 1e-9: a duration of whole steps must not get one more by rounding.
        steps = max(1, math.ceil(duration / self._timestep - 1e-9))
        passed = self._line.passed(command[None].copy(), duration)
        pieces = [(torque[0], length) for torque, length in passed]
        # The usual case in one call of the engine: one constant torque, no lag, no change of load.
        if len(pieces) == 1 and not self._lag and not self._load_is_due(duration):
            self.acting = pieces[0][0].copy()
            self._run(self.acting, duration / steps, steps)
            return
        for torque in _means(pieces, duration, steps):
            if self._load_is_due(0.0):
                self._now = self._loaded  # the same joints, so the same data
            self._run(self._after_lag(torque, duration / steps), duration / steps, 1)

    def _run(self, torque: Array, length: float, steps: int) -> None:
        self._now.opt.timestep = length
        self._data.ctrl[:] = torque
        started = self._data.time
        _engine().mj_step(self._now, self._data, steps)
        # MuJoCo resets the data, its clock included, when the simulation becomes unstable.
        self._lost = self._data.time <= started
        self._time += length * steps

    def _load_is_due(self, within: float) -> bool:
        waits = self._now is not self._loaded
        # Half a step earlier: the load comes at the step whose start is nearest to its time.
        return waits and self._time + within > self._load_time - 0.5 * self._timestep

    def _after_lag(self, torque: Array, length: float) -> Array:
        """Mean of what acts in a step while the drives follow ``torque`` with a first-order lag."""
        if not self._lag:
            self.acting = torque
            return torque
        # The engine holds a torque through its step, so it gets the mean of the exact solution.
        behind, decay = self.acting - torque, math.exp(-length / self._lag)
        self.acting = torque + behind * decay
        return torque + behind * (1.0 - decay) * self._lag / length

    # Looking ----------------------------------------------------------------------------------

    def read(self, twist: Array, pose: Array, angle: Array, rate: Array) -> None:
        """Fill twist (3,), pose (3,), wheel angles (4,) and wheel rates (4,)."""
        if self._lost:
            for values in (twist, pose, angle, rate):
                values[:] = math.nan
            return
        q, v = self._data.qpos, self._data.qvel
        a, b, c, d = q[3:7].tolist()
        yaw = math.atan2(2 * (a * d + b * c), 1 - 2 * (c * c + d * d))
        vx, vy, cos, sin = float(v[0]), float(v[1]), math.cos(yaw), math.sin(yaw)
        twist[:] = cos * vx + sin * vy, cos * vy - sin * vx, v[5]
        pose[:] = q[0], q[1], yaw
        angle[:], rate[:] = q[self._q], v[self._v]

    @property
    def height(self) -> float:
        """Of O above the floor [m]."""
        return float(self._data.qpos[2])

    @property
    def energy(self) -> float:
        """Kinetic and potential energy [J]."""
        # A copy: mj_forward writes into the data, and looking must not change the run.
        engine, bodies, data = _engine(), self._now, copy.copy(self._data)
        engine.mj_forward(bodies, data)
        # M qvel, so that half of qvel . M qvel is the kinetic energy.
        momentum = np.zeros(bodies.nv)
        engine.mj_mulM(bodies, data, momentum, data.qvel)
        weight = -bodies.body_mass[:, None] * bodies.opt.gravity
        return float(0.5 * data.qvel @ momentum + (weight * data.xipos).sum())


def _means(pieces: list[tuple[Array, float]], duration: float, steps: int) -> Array:
    """Mean torques (steps, 4) in equal steps of torques that are each held for their time."""
    time = np.cumsum([0.0, *(length for _, length in pieces)])
    # The integral of a held torque is linear between its changes, so interpolation is exact.
    impulse = np.cumsum([np.zeros(4), *(torque * length for torque, length in pieces)], axis=0)
    grid = np.linspace(0.0, duration, steps + 1)
    passed = np.stack([np.interp(grid, time, column) for column in impulse.T], axis=1)
    return np.diff(passed, axis=0) * (steps / duration)


def _engine() -> Any:
    return optional_library("mujoco", "mujoco", "a plant with contacts needs MuJoCo")
