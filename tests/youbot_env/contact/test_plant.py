"""MuJoCo's rollers on a floor: the laws they keep, and how far from the ideal model they are."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import youbot_env  # noqa: F401 - registers the environment
from youbot_env.contact.mjcf import mjcf, profile
from youbot_env.contact.plant import ContactPlant
from youbot_env.contact.settings import Contact, EngineSettings
from youbot_env.errors import InputError
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import Geometry
from youbot_env.simulation.plant import Plant

mujoco = pytest.importorskip("mujoco")

PAPER = load_model("paper")
TIME = 0.01 * np.arange(400)
REST = np.zeros(4)


def frictionless() -> Model:
    return PAPER.with_values({"mu1": 0.0, "mu2": 0.0})


def torques(seed: int = 0, peak: float = 1.5, time: np.ndarray = TIME) -> np.ndarray:
    """Smooth torques (N, 4) [N m] that ask for nothing but generalised forces."""
    rng = np.random.default_rng(seed)
    force = np.zeros((len(time), 3))
    for frequency in (0.7, 1.1, 1.9, 2.7):
        phase = rng.uniform(0.0, 2 * np.pi, 3)
        force += rng.uniform(0.3, 1.0, 3) * np.sin(frequency * time[:, None] + phase)
    wheel = PAPER.geometry.wheel_torque(force * (14.0, 16.0, 5.0))
    return peak / np.abs(wheel).max() * wheel


def driven(plant: Plant | ContactPlant, torque: np.ndarray, step: float = 0.01, **start):
    """Twists, poses and wheel speeds before and after each of the torques (N, 4)."""
    plant.reset(**start)
    seen = [(plant.twist, plant.pose, plant.wheel_speed)]
    for row in torque:
        plant.step(row, step)
        seen.append((plant.twist, plant.pose, plant.wheel_speed))
    return tuple(np.array(part) for part in zip(*seen, strict=True))


def relative(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """RMS deviation of each column over its RMS."""
    return np.sqrt(((found - expected) ** 2).mean(axis=0) / (expected**2).mean(axis=0))


@pytest.fixture(scope="module")
def plant() -> ContactPlant:
    return ContactPlant(PAPER)


# --- The bodies --------------------------------------------------------------------------------


@pytest.mark.parametrize("loaded", [False, True])
def test_bodies_have_the_mass_matrix_of_the_model(loaded: bool):
    model = PAPER.with_effect("payload_change", mass=5.0, x=0.1, y=-0.05, time=0.0)
    compiled = mujoco.MjModel.from_xml_string(mjcf(model, Contact(), loaded=loaded))
    data, v = mujoco.MjData(compiled), PAPER.values
    mujoco.mj_forward(compiled, data)
    columns = []
    for unit in np.eye(compiled.nv):
        out = np.zeros(compiled.nv)
        mujoco.mj_mulM(compiled, data, out, unit)
        columns.append(out)
    found, m = np.array(columns), v["m0"] - 4 * PAPER.geometry.m1
    load = 5.0 * loaded
    assert found[0, 0] == pytest.approx(v["m0"] + load)
    assert found[0, 5] == pytest.approx(-m * v["aY"] + 0.05 * load)
    assert found[1, 5] == pytest.approx(m * v["aX"] + 0.1 * load)
    assert found[5, 5] == pytest.approx(v["I0"] + load * (0.1**2 + 0.05**2), rel=1e-4)
    for name in ("fl", "fr", "bl", "br"):
        wheel = compiled.joint(name).dofadr[0]
        assert found[wheel, wheel] == pytest.approx(v["I1"], rel=2e-3)


def test_a_wheel_s_height_hardly_ripples():
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    height = profile(Geometry(), 16, angle)
    assert np.ptp(height) < 12e-6 and abs(height.mean() - Geometry().R) < 12e-6
    assert np.ptp(profile(Geometry(), 8, angle)) > 10 * np.ptp(height), "few rollers do bump"


def test_the_engine_s_wheels_have_that_height():
    compiled = mujoco.MjModel.from_xml_string(mjcf(PAPER, Contact()))
    data, wheel = mujoco.MjData(compiled), compiled.joint("br").qposadr[0]
    data.qpos[2] = 0.0475 - 1e-4  # pressed into the floor, so that each wheel has a contact
    for angle in np.linspace(0.0, 0.5, 23):
        data.qpos[wheel] = angle
        mujoco.mj_forward(compiled, data)
        rollers = compiled.geom_bodyid[data.contact.geom].max(axis=1)
        deepest = data.contact.dist[compiled.body_parentid[rollers] == compiled.jnt_bodyid[-17]]
        height = 0.0475 - 1e-4 - deepest.min()
        assert height == pytest.approx(profile(PAPER.geometry, 16, np.array(angle)), abs=1e-9)


# --- Laws --------------------------------------------------------------------------------------


def test_stands_still_on_the_flat(plant: ContactPlant):
    twist, pose, wheels = driven(plant, np.zeros((20, 4)), 0.1)
    assert np.abs(pose).max() < 1e-5 and np.abs(twist).max() < 1e-4
    assert np.abs(wheels).max() < 1e-3


@pytest.mark.parametrize("model", [PAPER, frictionless()], ids=["paper", "frictionless"])
def test_energy_never_grows_without_torque(model: Model):
    plant = ContactPlant(model)
    plant.reset(twist=(0.3, 0.2, 0.6))
    energy = [plant.energy]
    for _ in range(150):
        plant.step(REST, 0.01)
        energy.append(plant.energy)
    assert np.diff(energy).max() < 1e-6 * energy[0]
    assert energy[-1] < energy[0]


def test_starts_without_slip_and_yaw_does_not_wrap(plant: ContactPlant):
    start = {"twist": (0.2, -0.1, 1.0), "pose": (1.0, -2.0, 9.0), "wheel_angle": (1, 2, -30, 4)}
    plant.reset(**start, time=5.0)
    np.testing.assert_allclose(plant.twist, start["twist"], atol=1e-5)
    np.testing.assert_allclose(plant.pose, start["pose"], atol=1e-4)
    np.testing.assert_allclose(plant.wheel_angle, start["wheel_angle"], atol=1e-3)
    expected = PAPER.geometry.wheel_speeds(start["twist"])
    np.testing.assert_allclose(plant.wheel_speed, expected, atol=1e-12)
    for _ in range(30):
        plant.step((-1.5, 1.5, -1.5, 1.5), 0.1)
    assert 9.5 < plant.pose[2] < 30.0 and plant.state[10] == pytest.approx(8.0)


def test_a_slope_accelerates_by_g_sin():
    """Without friction (m0 + 4 I1/R^2) a = -m0 g sin(tilt) downhill; the wheels roll."""
    model = frictionless().with_effect("floor_tilt", tilt_x=0.02, tilt_y=-0.01)
    plant, v = ContactPlant(model), model.values
    plant.reset(pose=(0.0, 0.0, np.pi / 2))
    plant.step(REST, 1.0)
    inertia = v["m0"] + 4 * v["I1"] / model.geometry.R**2
    fall = v["m0"] * 9.80665 * np.sin((0.02, -0.01)) / inertia
    # Facing +Y: body X looks along world Y, body Y against world X.
    np.testing.assert_allclose(plant.twist[:2], [-fall[1], fall[0]], rtol=0.05)
    np.testing.assert_allclose(plant.pose[:2], -fall / 2, rtol=0.05)


# --- Beside the ideal model --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("peak", "bound"), [(0.7, (0.03, 0.06, 0.05)), (2.0, (0.02, 0.05, 0.04))], ids=["slow", "fast"]
)
def test_moves_nearly_as_the_ideal_model_does(plant: ContactPlant, peak: float, bound):
    torque = torques(peak=peak)
    real, ideal = driven(plant, torque), driven(Plant(PAPER), torque)
    errors = relative(real[0], ideal[0])
    drift = np.abs(real[1][-1] - ideal[1][-1])
    slip = (real[2] - PAPER.geometry.wheel_speeds(real[0])).std() / real[2].std()
    print(f"\n{peak} N m: twist off by {errors.round(4)}, wheel slip {slip:.4f}, pose off {drift}")
    assert (errors < bound).all() and slip < 0.02
    assert (drift < (0.03, 0.03, 0.03)).all()


def test_fewer_rollers_bump_more():
    """The twist's deviation from the ideal model, and the ripple of the height, rolling ahead."""
    torque, deviations, ripples = torques(peak=2.0), [], []
    ideal = driven(Plant(PAPER), torque)[0]
    for rollers in (16, 12, 8):
        plant = ContactPlant(PAPER, Contact(rollers=rollers))
        deviations.append(relative(driven(plant, torque)[0], ideal))
        plant.reset(twist=(0.4, 0.0, 0.0))
        height = []
        for _ in range(100):
            plant.step(np.full(4, 0.9), 0.01)
            height.append(plant.height)
        ripples.append(1e6 * np.std(height))
        print(f"\n{rollers} rollers: twist off by {deviations[-1].round(4)}", end=", ")
        print(f"height ripples by {ripples[-1]:.1f} micrometres")
    assert ripples[0] < 3.0 < ripples[2]
    assert deviations[0][0] < deviations[1][0] < deviations[2][0] < 0.1


def test_effective_masses_are_the_model_s(plant: ContactPlant):
    """Least squares of force over acceleration and velocity gives m0 + 4 I1/R^2."""
    g, v = PAPER.geometry, PAPER.values
    force = g.body_force(torques(peak=2.0, time=0.02 * np.arange(300))) * (1.0, 1.0, 0.0)
    twist, _, _ = driven(plant, g.wheel_torque(force), 0.02)
    # Integrated over time, so that the rollers' ripple does not stand in an acceleration.
    mean = (twist[1:] + twist[:-1]) / 2
    (dx, dy, dw), (vx, vy, w) = np.diff(twist, axis=0).T / 0.02, mean.T
    m = v["m0"] - 4 * g.m1
    force[:, 0] += m * (v["aY"] * dw + v["aX"] * w**2)  # the centre of mass, taken as known
    force[:, 1] -= m * (v["aX"] * dw - v["aY"] * w**2)
    expected = v["m0"] + 4 * v["I1"] / g.R**2
    for axis, columns in enumerate(((dx - vy * w, vx), (dy + vx * w, vy))):
        rows = np.cumsum(np.stack([*columns, force[:, axis]], axis=1), axis=0)
        mass, _ = np.linalg.lstsq(rows[:, :2], rows[:, 2])[0]
        print(f"m0 + 4 I1/R^2 along {'XY'[axis]}: {mass:.2f} kg of {expected:.2f} kg")
        assert mass == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(
    ("name", "values", "bound"),
    [
        ("floor_tilt", {"tilt_x": 0.03, "tilt_y": -0.02}, 0.1),
        ("uneven_wheel_friction", {"extra_fr": 0.2}, 0.1),
        ("wheel_coulomb_friction", {"torque": 0.25}, 0.1),
        # A small change of the motion, and loaded rollers scrub more when the platform turns.
        ("payload_change", {"mass": 20.0, "x": 0.1, "y": 0.05, "time": 1.0}, 0.35),
        ("actuator_lag", {"time_constant": 0.2}, 0.1),
        ("torque_delay", {"delay": 0.1037}, 0.1),
    ],
)
def test_an_effect_does_what_it_does_to_the_model(
    name: str, values: dict[str, float], bound: float, unaffected
):
    model, torque = PAPER.with_effect(name, **values), torques(seed=3)[:300]
    here, there = (driven(kind(model), torque)[0] for kind in (ContactPlant, Plant))
    made, expected = (
        with_it - without for with_it, without in zip((here, there), unaffected, strict=True)
    )
    miss = np.sqrt(((made - expected) ** 2).sum() / (expected**2).sum())
    print(f"{name}: off by {miss:.3f} of what it does to the model")
    assert miss < bound


@pytest.fixture(scope="module")
def unaffected(plant: ContactPlant) -> tuple[np.ndarray, np.ndarray]:
    """Twists of the paper's platform, with contacts and ideal."""
    torque = torques(seed=3)[:300]
    return driven(plant, torque)[0], driven(Plant(PAPER), torque)[0]


def test_dry_friction_holds_a_platform_still():
    plant = ContactPlant(PAPER.with_effect("wheel_coulomb_friction", torque=0.25))
    plant.reset()
    plant.step(np.full(4, 0.2), 1.0)
    assert np.abs(plant.twist).max() < 1e-3
    plant.step(np.full(4, 0.5), 1.0)
    assert plant.twist[0] > 0.05


def test_wheels_spin_on_ice():
    """No more force than friction times weight gets through, however hard the wheels are turned."""
    plant = ContactPlant(PAPER, Contact(friction=0.02))
    plant.reset()
    plant.step(np.full(4, 2.0), 1.0)
    assert 0.1 < plant.twist[0] < 0.02 * 9.81 * 1.1
    assert (plant.wheel_speed * PAPER.geometry.R > 2.0 * plant.twist[0]).all()


def test_what_arrives_is_delayed_and_lags():
    lag, delay = 0.05, 0.0203
    names = {"torque_delay": {"delay": delay}, "actuator_lag": {"time_constant": lag}}
    model = PAPER
    for name, values in names.items():
        model = model.with_effect(name, **values)
    plant, command = ContactPlant(model, platforms=1), np.full((1, 4), 0.6)
    acting = []
    for _ in range(20):
        plant.advance(command, 0.01)
        acting.append(plant.acting_torque(command)[0, 0])
    after = np.maximum(0.01 * np.arange(1, 21) - delay, 0.0)
    np.testing.assert_allclose(acting, 0.6 * (1 - np.exp(-after / lag)), atol=0.6 * 0.001 / lag)
    np.testing.assert_array_equal(plant.states[0, 11:15], plant.acting_torque(command)[0])


# --- The interface of a plant ------------------------------------------------------------------


def test_a_run_is_repeated_to_the_bit_and_goes_on_after_copying(plant: ContactPlant):
    torque = torques(seed=1)[:60]
    first, again = (driven(plant, torque, twist=(0.1, 0.0, 0.2)) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
    twins = [plant, copy.deepcopy(plant), pickle.loads(pickle.dumps(plant))]
    states = [twin.step(np.ones(4), 0.05) for twin in twins]
    np.testing.assert_array_equal(states[0], states[1])
    np.testing.assert_array_equal(states[0], states[2])


def test_platforms_side_by_side_do_not_know_of_each_other(plant: ContactPlant):
    many = ContactPlant(PAPER, platforms=3)
    many.reset(row=1, twist=(0.2, 0.1, 0.3))
    plant.reset(twist=(0.2, 0.1, 0.3))
    rows = np.stack([REST, np.ones(4), -np.ones(4)])
    for _ in range(10):
        many.step(rows, 0.01)
        plant.step(rows[1], 0.01)
    np.testing.assert_array_equal(many.state[1], plant.state)
    np.testing.assert_array_equal(many.wheel_speed[1], plant.wheel_speed)
    assert many.twist[2, 0] < 0.0 and np.abs(many.twist[0]).max() < 1e-3
    with pytest.raises(InputError, match="no finite number"):
        many.step(np.stack([REST, np.full(4, np.nan), REST]), 0.01)
    assert np.isfinite(many.twist).all(), "nothing has moved"
    heavier = PAPER.with_values({"m0": 70.0})
    many.reset(heavier, row=1)
    for _ in range(30):
        many.step(np.ones((3, 4)), 0.01)
    assert 0.0 < many.twist[1, 0] < 0.8 * many.twist[0, 0]
    assert many.models == [PAPER, heavier, PAPER]


def test_a_platform_that_the_engine_gives_up_is_nan_until_reset(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine leaves its complaint in a file
    plant = ContactPlant(PAPER)
    plant.step(np.ones(4), 0.05)
    plant._bodies[0]._data.qvel[2] = 1e12
    for _ in range(2):
        plant.step(REST, 0.01)
        assert np.isnan(plant.twist).all() and np.isnan(plant.wheel_speed).all()
    plant.reset()
    plant.step(np.ones(4), 0.05)
    assert plant.twist[0] > 0.01


def test_long_holds_are_cut_into_steps_of_the_engine(plant: ContactPlant):
    plant.reset()
    plant.step(np.ones(4), 0.0305)
    assert plant.state[10] == pytest.approx(0.0305)
    whole = plant.twist
    driven(plant, np.ones((61, 4)), 0.0005)
    np.testing.assert_allclose(whole, plant.twist, rtol=0.02, atol=1e-5)


def wrong(**values: float) -> Model:
    merged = {name: PAPER.values[name] for name in BASE_UNITS} | values
    return Model(PAPER.geometry, {n: Estimate(merged[n], unit) for n, unit in BASE_UNITS.items()})


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: Contact(friction=0.0), "contact friction: 0.0 must be positive"),
        (lambda: Contact(friction=float("nan")), "contact friction"),
        (lambda: Contact(timestep=0.01), "too coarse"),
        (lambda: Contact(rollers=5), "contact rollers: 5 must be at least 6"),
        (lambda: Contact(rollers=8.5), "contact rollers"),  # pyright: ignore[reportArgumentType]
        (lambda: Contact(com_height=-0.1), "contact com_height"),
        (lambda: ContactPlant(PAPER, platforms=0), "platforms must be at least 1"),
        (lambda: ContactPlant(PAPER.with_effect("tether", stiffness=1.0)), "effect tether cannot"),
        (lambda: ContactPlant(wrong(I1=1e-6)), "I1 = 1e-06 kg m^2 is too small"),
        (lambda: ContactPlant(wrong(I0=0.4, aX=0.0, aY=0.0)), "I0 = 0.4 kg m^2 is less than"),
        (lambda: ContactPlant(wrong(aX=0.3, I0=9.0)), "the platform tips over"),
        (
            lambda: ContactPlant(
                PAPER.with_effect("payload_change", mass=60.0, x=0.4, y=0.0, time=0.0)
            ),
            "tips over",
        ),
        (
            lambda: ContactPlant(replace(PAPER, geometry=Geometry(m1=0.0))),
            "needs wheels with m1 > 0",
        ),
        (lambda: ContactPlant(PAPER).step(np.zeros(3), 0.01), "four torques per platform"),
        (lambda: ContactPlant(PAPER).reset(PAPER.with_effect("floor_tilt")), "other effects"),
        (lambda: ContactPlant(PAPER).reset(twist=(1.0,)), "twist must hold 3 numbers"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make, fragment: str):
    with pytest.raises(InputError, match=fragment.replace("^", r"\^")):
        make()


def test_without_mujoco_only_the_plant_is_missing():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from youbot_env.contact.plant import ContactPlant\n"
        "import gymnasium as gym, youbot_env\n"
        "gym.make('YouBotTracking-v0').reset(seed=0)\n"
        "try: ContactPlant('paper')\n"
        "except youbot_env.InputError as error: print(error)\n"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert found.stdout.strip() == (
        "a plant with contacts needs MuJoCo: pip install 'youbot[mujoco]'"
    ), found.stderr


# --- The environment ---------------------------------------------------------------------------


def episode(seed: int = 0, steps: int = 40, **options):
    env = gym.make("YouBotTracking-v0", **options).unwrapped
    observation, info = env.reset(seed=seed)
    observations, infos = [observation], [info]
    for k in range(steps):
        observation, _, _, _, info = env.step(0.4 * np.sin(0.05 * k * np.array([1, 2, 3, 4])))
        observations.append(observation)
        infos.append(info)
    return np.array(observations), infos


def test_an_environment_can_run_on_it_and_repeats_to_the_bit():
    options = {"plant": "contact", "encoder_ticks": 103_352, "wheel_speed_noise": 0.01}
    first, infos = episode(**options, delay=2, lag=0.02)
    again, _ = episode(**options, delay=2, lag=0.02)
    np.testing.assert_array_equal(first, again)
    ideal, _ = episode(wheel_speed_noise=0.01, encoder_ticks=103_352, delay=2, lag=0.02)
    assert not np.array_equal(first, ideal)
    np.testing.assert_allclose(first, ideal, atol=0.05)
    assert infos[-1]["time"] == pytest.approx(0.4)
    assert infos[-1]["parameters"]["actuator_lag.time_constant"] == 0.02


def test_the_environment_s_sensors_read_wheels_that_slip():
    options = {"plant": Contact(friction=0.03), "initial_state": {"twist": (0.2, 0.0, 0.1)}}
    for ticks in (None, 1e9):
        _, infos = episode(encoder_ticks=ticks, **options)
        last, before = infos[-1], infos[-2]
        rolling = PAPER.geometry.wheel_speeds(last["twist"])
        assert np.abs(last["wheel_speed"] - rolling).max() > 0.1
        turned = (last["wheel_angle"] - before["wheel_angle"]) / 0.01
        np.testing.assert_allclose(last["wheel_speed"], turned, atol=1e-6 if ticks else 0.5)
        np.testing.assert_allclose(
            infos[0]["wheel_speed"], PAPER.geometry.wheel_speeds((0.2, 0.0, 0.1)), atol=1e-4
        )


def test_an_environment_draws_bodies_for_each_episode():
    options = {"effects": {"floor_tilt": {"tilt_x": 0.0}}, "plant": "contact"}
    ranges = {"floor_tilt.tilt_x": (0.01, 0.05)}
    found = [episode(seed, 20, randomise=ranges, **options)[1][-1] for seed in (0, 1)]
    tilts = [info["parameters"]["floor_tilt.tilt_x"] for info in found]
    assert tilts[0] != tilts[1]
    assert all(0.01 <= tilt <= 0.05 for tilt in tilts)


@pytest.mark.parametrize("plant", ["mujoco", 3, None])
def test_an_environment_refuses_other_plants(plant):
    with pytest.raises(InputError, match="is none of 'model', 'contact'"):
        gym.make("YouBotTracking-v0", plant=plant)


def test_the_step_is_the_coarsest_that_resolves_contacts():
    assert Contact().timestep == EngineSettings.max_timestep
