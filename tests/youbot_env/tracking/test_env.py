"""What YouBotTracking-v0 promises in its docstring."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from controllers.interface import Observation, Reference
from controllers.kinematic import KinematicControl
from tests.youbot_env.structures import exact_step
from youbot_env import Estimate, InputError, Plant, load_model, save_model
from youbot_env.motions.calibration import motion_iii
from youbot_env.physics import hardware
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_env.tracking.task import REWARD_TERMS, tolerance

NOISY = {
    "wheel_speed_noise": 0.02,
    "encoder_ticks": hardware.ENCODER_TICKS,
    "delay": 2,
    "lag": 0.03,
    "action_history": 3,
    "randomise": {"m0": ("80%", "120%"), "aY": ("80%", "120%"), "mu1": (0.08, 0.14)},
}


def paper_with_covariance(spread=0.02):
    model = load_model("paper")
    names = tuple(model.parameters)
    std = np.array([spread * abs(model.values[name]) for name in names])
    return type(model)(
        model.geometry,
        {k: Estimate(v.value, v.unit, spread * abs(v.value)) for k, v in model.parameters.items()},
        covariance=np.diag(std**2),
        covariance_names=names,
    )


def episode(env, seed, steps=150):
    """Everything that an episode with random actions shows, as one flat array."""
    observation, info = env.reset(seed=seed)
    rng, shown = np.random.default_rng(seed), [observation]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 4))
        shown += [observation, [reward, terminated, truncated], *flat(info)]
    return np.concatenate(shown)


def flat(info):
    for value in info.values():
        yield np.ravel(list(value.values()) if isinstance(value, dict) else value)


@pytest.mark.parametrize("options", [{}, NOISY], ids=["plain", "all options"])
def test_gymnasium_finds_nothing_to_warn_about(options, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pytest.importorskip("pygame")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make("YouBotTracking-v0", episode_length=0.2, **options).unwrapped)


def test_stable_baselines3_finds_nothing_to_warn_about():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(YouBotTrackingEnv(**NOISY), warn=True)


@pytest.mark.parametrize("options", [{}, NOISY], ids=["plain", "all options"])
def test_same_seed_same_episode_to_the_bit(options):
    first = YouBotTrackingEnv(**options)
    again = YouBotTrackingEnv(**options)
    once = episode(first, 5)
    assert np.array_equal(once, episode(again, 5))
    assert np.array_equal(once, episode(first, 5))
    assert not np.array_equal(once, episode(first, 6))


def test_noise_and_randomisation_leave_the_reference_of_a_seed_alone():
    plain, noisy = YouBotTrackingEnv(), YouBotTrackingEnv(**NOISY)
    plain.reset(seed=3)
    noisy.reset(seed=3)
    assert plain.reference == noisy.reference


@pytest.mark.parametrize("copier", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_as_the_original(copier):
    env = YouBotTrackingEnv(**NOISY)
    episode(env, 1, 20)
    twin = copier(env)
    for _ in range(20):
        mine, theirs = (e.step(np.full(4, 0.3)) for e in (env, twin))
        assert np.array_equal(mine[0], theirs[0]) and mine[1] == theirs[1]
    assert np.array_equal(env.reset()[0], twin.reset()[0])


def test_a_vector_of_them_gives_each_its_own_course():
    vector = gym.make_vec("YouBotTracking-v0", 3, vectorization_mode="sync", **NOISY)
    vector.reset(seed=[1, 2, 3])  # pyright: ignore[reportArgumentType] - one seed each
    for _ in range(5):
        seen, *_, info = vector.step(np.full((3, 4), 0.2, np.float32))
    single = YouBotTrackingEnv(**NOISY)
    single.reset(seed=2)
    for _ in range(5):
        alone, *_, known = single.step(np.full(4, 0.2, np.float32))
    assert np.array_equal(seen[1], alone)
    assert info["parameters"]["m0"][1] == known["parameters"]["m0"]


def test_what_was_handed_out_stays_as_it_was():
    env = YouBotTrackingEnv()
    env.reset(seed=0)
    observation, *_, info = env.step(np.full(4, 0.5))
    before = observation.copy(), {k: copy.deepcopy(v) for k, v in info.items()}
    env.step(np.full(4, -0.5))
    env.reset()
    assert np.array_equal(observation, before[0])
    assert np.array_equal(np.concatenate([*flat(info)]), np.concatenate([*flat(before[1])]))


def test_observation_holds_what_the_table_says():
    env = YouBotTrackingEnv(action_history=2, preview=3)
    env.reset(seed=4)
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 4))
    for action in actions:
        observation, *_, info = env.step(action)
    scale = (0.8, 0.8, hardware.MAX_WHEEL_SPEED * 0.0475 / 0.3855)
    reference = env.reference
    assert reference is not None
    coming = reference.twist(info["time"] + 0.01 * np.arange(4)) / scale
    expected = [info["twist"] / scale, *coming, actions[-1], actions[-2]]
    assert observation == pytest.approx(np.concatenate(expected), abs=1e-6)
    assert info["time"] == pytest.approx(2.0)
    assert info["reference_twist"] == pytest.approx(reference.twist(2.0))
    assert info["reference_acceleration"] == pytest.approx(reference.acceleration(2.0))
    assert info["tracking_error"] == pytest.approx(info["reference_twist"] - info["twist"])


def test_truncates_on_time_and_does_not_terminate():
    env = YouBotTrackingEnv(episode_length=0.5)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4))[2:4] for _ in range(50)]
    assert ends == [(False, False)] * 49 + [(False, True)]
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4))


def test_terminates_only_where_no_platform_can_be():
    frictionless = load_model("paper").with_values({"mu1": 0.0, "mu2": 0.0})
    env = YouBotTrackingEnv(frictionless, initial_state={"twist": (2.0, 0.0, 0.0)})
    env.reset(seed=0)
    speed, terminated = 2.0, False
    while not terminated:
        assert speed <= 4.0
        observation, reward, terminated, truncated, info = env.step(np.ones(4))
        speed = np.abs(info["twist"][:2]).max()
        assert not truncated and 0 <= reward <= 1
        assert env.observation_space.contains(observation)
    assert speed > 4.0
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4))


def test_a_state_that_is_not_finite_terminates_with_a_valid_observation():
    env = YouBotTrackingEnv()
    env.reset(seed=0)
    env._rows.set_state(0, np.full(len(env.state), np.nan))  # pyright: ignore
    observation, reward, terminated, truncated, _ = env.step(np.zeros(4))
    assert terminated and not truncated and 0 <= reward <= 1
    assert env.observation_space.contains(observation)


def test_random_actions_never_terminate():
    env = YouBotTrackingEnv()
    for seed in range(3):
        env.reset(seed=seed)
        rng = np.random.default_rng(seed)
        assert not any(env.step(np.sign(rng.uniform(-1, 1, 4)))[2] for _ in range(1000))


@pytest.mark.parametrize("lag", [None, 0.03])
def test_integration_agrees_with_scipy(lag: float | None):
    env = YouBotTrackingEnv(lag=lag)
    env.reset(seed=0)
    rng, model = np.random.default_rng(1), env.model
    state, worst = env.state, 0.0
    for _ in range(100):
        *_, info = env.step(rng.uniform(-1, 1, 4))
        torque = info["commanded_torque"]
        state = exact_step(model, state, torque, 0.01)
        worst = max(worst, np.abs(env.state - state)[:10].max())
    assert worst < (1e-6 if lag else 1e-7)


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05])
def test_torques_that_jump_to_their_limits_leave_less_than_1e_6_in_the_twist(period: float):
    randomise = {"m0": ("60%", "120%"), "mu1": ("60%", "180%")}
    env = YouBotTrackingEnv(control_rate=1 / period, randomise=randomise)
    rng, worst = np.random.default_rng(2), 0.0
    for seed in range(4):
        env.reset(seed=seed)
        exact = Plant(env.model, substeps=60)
        for _ in range(100):
            *_, info = env.step(np.sign(rng.uniform(-1, 1, 4)))
            exact.step(info["commanded_torque"], period)
            worst = max(worst, np.abs(env.state[:3] - exact.twist).max())
    assert 1e-9 < worst < 1e-6


def test_torque_limit_is_the_nominal_motor_torque_through_the_gear():
    env = YouBotTrackingEnv()
    env.reset(seed=0)
    *_, info = env.step(np.array([1.0, -1.0, 0.5, 0.999]))
    full = 0.0335 * 2.32 * 9405 / 364
    assert info["commanded_torque"] == pytest.approx(full * np.array([1, -1, 0.5, 0.999]))
    assert info["applied_torque"] == pytest.approx(info["commanded_torque"])
    assert info["saturated"].tolist() == [True, True, False, False]
    assert env.to_action([9.0, -9.0, full / 2, 0.0]) == pytest.approx([1.0, -1.0, 0.5, 0.0])


def test_a_torque_that_a_controller_held_is_told_in_info_once():
    env, control = YouBotTrackingEnv(), KinematicControl(sample_time=0.01)
    _, info = env.reset(seed=0)
    wanted = Reference(np.array([0.3, 0.1, 0.2]), np.zeros(3))
    commands = []
    for lost in (None, 2, None):
        speed = np.array(info["wheel_speed"])
        if lost is not None:
            speed[lost] = np.nan
        torque = control(Observation(info["time"], speed, info["measured_twist"]), wanted)
        *_, info = env.step(env.to_action(torque, control.held))
        assert info["held"].tolist() == [wheel == lost for wheel in range(4)]
        commands.append(info["commanded_torque"])
    assert commands[1][2] == commands[0][2] != commands[2][2]
    env.to_action(torque, (True,) * 4)
    assert not env.reset(seed=0)[1]["held"].any() and not env.step(np.zeros(4))[-1]["held"].any()
    with pytest.raises(InputError, match="held: 3 values, expected 4"):
        env.to_action(torque, (True,) * 3)


def test_delay_holds_torque_back_by_whole_periods():
    env = YouBotTrackingEnv(delay=3)
    env.reset(seed=0)
    # In single precision, in which actions count.
    actions = np.random.default_rng(0).uniform(-1, 1, (30, 4)).astype(np.float32)
    plant = Plant("paper")
    late = np.vstack([np.zeros((3, 4)), actions]) * env.torque_limit
    for action, torque in zip(actions, late[:30], strict=True):
        *_, info = env.step(action)
        plant.step(torque, 0.01)
        assert info["applied_torque"] == pytest.approx(torque, abs=1e-15)
        assert info["twist"] == pytest.approx(plant.twist, abs=1e-14)


def test_lag_lets_torque_rise_exponentially():
    env = YouBotTrackingEnv(lag=0.05, torque_limit=1.0)
    env.reset(seed=0)
    for k in range(1, 20):
        *_, info = env.step(np.full(4, 0.4))
        expected = 0.4 * (1 - np.exp(-0.01 * k / 0.05))
        assert info["applied_torque"] == pytest.approx(np.full(4, expected), abs=1e-6)


def test_gain_error_shows_in_applied_torque():
    env = YouBotTrackingEnv(effects={"torque_gain_error": {"gain_fl": 0.1, "gain_fr": -0.1}})
    env.reset(seed=0)
    *_, info = env.step(np.full(4, 0.5))
    assert info["applied_torque"] / info["commanded_torque"] == pytest.approx([1.1, 0.9, 1, 1])


def measured_errors(**options):
    env = YouBotTrackingEnv(**options)
    env.reset(seed=0)
    jacobian, errors = env.model.geometry.wheel_jacobian, []
    for k in range(1000):
        *_, info = env.step(0.5 * np.sin(0.02 * k + np.arange(4)))
        errors.append(info["wheel_speed"] - jacobian @ info["twist"])
        assert info["measured_twist"] == pytest.approx(
            env.model.geometry.body_twist(info["wheel_speed"])
        )
    return np.array(errors)


def test_wheel_speed_noise_is_white_and_as_large_as_asked():
    errors = measured_errors(wheel_speed_noise=0.05)
    assert errors.std(axis=0) == pytest.approx(np.full(4, 0.05), rel=0.1)
    assert np.abs(errors.mean(axis=0)).max() < 4 * 0.05 / np.sqrt(1000)
    correlation = np.corrcoef(np.hstack([errors[1:], errors[:-1]]).T) - np.eye(8)
    assert np.abs(correlation).max() < 0.15


@pytest.mark.parametrize("encoder_ticks", [2000, hardware.ENCODER_TICKS])
def test_encoder_speeds_are_whole_counts_of_the_period(encoder_ticks):
    count = 2 * np.pi / encoder_ticks / 0.01
    env = YouBotTrackingEnv(encoder_ticks=encoder_ticks, initial_state={"twist": (0.3, 0.0, 0.0)})
    _, info = env.reset(seed=0)
    assert np.abs(info["wheel_speed"] - 0.3 / 0.0475).max() < count
    angle = np.zeros(4)
    for _ in range(200):
        last = angle
        *_, info = env.step(np.full(4, 0.3))
        angle = info["wheel_angle"]
        ticks = info["wheel_speed"] / count
        assert ticks == pytest.approx(np.rint(ticks), abs=1e-6)
        assert np.abs(info["wheel_speed"] - (angle - last) / 0.01).max() < count


def test_ranges_are_respected_and_told():
    env = YouBotTrackingEnv(**NOISY)
    drawn = []
    for seed in range(60):
        _, info = env.reset(seed=seed)
        assert info["parameters"] == env.model.values
        drawn.append([info["parameters"][name] for name in ("m0", "aY", "mu1", "I0")])
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    bounds = np.array([(0.8 * 35.3, 1.2 * 35.3), (-1.2 * 0.026, -0.8 * 0.026), (0.08, 0.14)])
    assert (low[:3] >= bounds[:, 0]).all() and (high[:3] <= bounds[:, 1]).all()
    assert ((high - low)[:3] > 0.8 * np.ptp(bounds, axis=1)).all()
    assert low[3] == high[3] == 4.4


def test_parameters_drawn_from_the_covariance_move_the_platform(tmp_path):
    save_model(tmp_path / "model.json", paper_with_covariance())
    env = gym.make(
        "youbot_env:YouBotTracking-v0",
        model=str(tmp_path / "model.json"),
        randomise="covariance",
        effects={"floor_tilt": {"tilt_x": 0.01}},
    )
    masses, speeds = [], []
    for seed in range(60):
        _, info = env.reset(seed=seed)
        masses.append(info["parameters"]["m0"])
        for _ in range(10):
            *_, info = env.step(np.full(4, 0.5, np.float32))
        speeds.append(info["twist"][0])
        assert info["parameters"]["floor_tilt.tilt_x"] == 0.01
    assert np.std(masses) == pytest.approx(0.02 * 35.3, rel=0.35)
    assert np.corrcoef(masses, speeds)[0, 1] < -0.5


def test_reward_is_the_weighted_mean_of_its_terms():
    env = YouBotTrackingEnv(reward_weights={"effort": 0.3}, reward_margins={"yaw_rate": 0.5})
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(300):
        _, reward, *_, info = env.step(rng.uniform(-1, 1, 4))
        terms = np.array(list(info["reward_terms"].values()))
        assert (terms >= 0).all() and (terms <= 1).all()
        assert reward == pytest.approx(terms @ (0.3, 0.3, 0.3, 0.3, 0.05) / 1.25)
    assert list(info["reward_terms"]) == list(REWARD_TERMS)
    yaw_rate = tolerance(info["tracking_error"][2], 0.5)
    assert info["reward_terms"]["yaw_rate"] == pytest.approx(yaw_rate)


def test_perfect_tracking_without_effort_is_worth_one():
    env = YouBotTrackingEnv(amplitude=(0.0, 0.0, 0.0))
    env.reset(seed=0)
    assert all(env.step(np.zeros(4))[1] == pytest.approx(1.0, abs=1e-15) for _ in range(50))
    assert env.step(np.ones(4))[1] < 0.95


def test_tolerance_is_one_at_zero_and_a_tenth_at_the_margin():
    assert tolerance(0.0, 0.3) == 1.0
    assert tolerance(-0.3, 0.3) == pytest.approx(0.1)
    assert tolerance(np.nan, 0.3) == 0.0
    assert 0.0 <= tolerance(np.inf, 0.3) < 1e-9


def test_start_and_reference_can_be_given():
    motion = motion_iii()
    start = {"twist": (0.1, 0.0, 0.2), "pose": (1.0, 2.0, 0.5)}
    env = YouBotTrackingEnv(initial_state=start, episode_length=1.0)
    _, info = env.reset(seed=0, options={"reference": motion})
    assert info["twist"].tolist() == [0.1, 0.0, 0.2] and info["pose"].tolist() == [1.0, 2.0, 0.5]
    *_, info = env.step(np.zeros(4))
    assert info["reference_twist"] == pytest.approx(motion.twist(0.01))
    _, info = env.reset(options={"initial_state": {"twist": (0.0, 0.3, 0.0)}})
    assert info["twist"].tolist() == [0.0, 0.3, 0.0] and info["pose"].tolist() == [1.0, 2.0, 0.5]
    assert env.reference != motion


def test_reference_keeps_within_its_band_and_is_alive_at_the_end():
    env = YouBotTrackingEnv(band=(1.0, 2.0), tones=3, episode_length=5.0)
    env.reset(seed=0)
    reference = env.reference
    assert reference is not None
    assert {1.0 <= tone.frequency <= 2.0 for tone in reference.tones} == {True}  # pyright: ignore
    assert np.abs(reference.acceleration(5.0)).max() > 0.01


BAD_OPTIONS = {
    "misspelt": ({"wheel_noise": 0.1}, "did you mean 'wheel_speed_noise'"),
    "unknown": ({"qqq": 1}, "unknown option 'qqq'"),
    "no file": ({"model": "no_such.json"}, "no such file"),
    "lag": ({"lag": 0.0}, "lag"),
    "delay": ({"delay": 1.5}, "whole number"),
    "negative delay": ({"delay": -1}, "at least 0"),
    "noise": ({"wheel_speed_noise": -1.0}, "at least 0"),
    "ticks": ({"encoder_ticks": 0}, "positive"),
    "limit": ({"torque_limit": np.nan}, "torque_limit"),
    "effect": ({"effects": {"glue": {}}}, "glue"),
    "effect value": ({"effects": {"floor_tilt": {"tilt_x": 9.0}}}, "outside"),
    "no covariance": ({"randomise": "covariance"}, "no covariance"),
    "randomise word": ({"randomise": "wildly"}, "wildly"),
    "range name": ({"randomise": {"mass": (1, 2)}}, "unknown parameter 'mass'"),
    "range order": ({"randomise": {"m0": (40, 30)}}, "empty"),
    "range text": ({"randomise": {"m0": ("80", "120%")}}, "80"),
    "range impossible": ({"randomise": {"m0": (1.0, 2.0)}}, "physical"),
    "band": ({"band": (3.0, 0.5)}, "band"),
    "band text": ({"band": "ab"}, "band"),
    "amplitude": ({"amplitude": (1.0,)}, "amplitude"),
    "ramp": ({"ramp": 0.0}, "ramp"),
    "tones": ({"tones": 0}, "tones"),
    "weights": ({"reward_weights": {"speed": 1}}, "unknown term 'speed'"),
    "margins": ({"reward_margins": {"effort": 0.0}}, "positive"),
    "start name": ({"initial_state": {"speed": 1}}, "unknown part 'speed'"),
    "start size": ({"initial_state": {"twist": (1, 2)}}, "3 finite numbers"),
    "start speed": ({"initial_state": {"twist": (90, 0, 0)}}, "faster"),
    "length": ({"episode_length": 0.0}, "episode_length"),
    "rate": ({"control_rate": -1}, "control_rate"),
    "reference": ({"reference": "sine"}, "Motion"),
    "render mode": ({"render_mode": "ascii"}, "render_mode"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_a_wrong_option_is_one_clear_line(case):
    options, words = BAD_OPTIONS[case]
    with pytest.raises(InputError) as caught:
        YouBotTrackingEnv(**options)
    assert words in str(caught.value) and "\n" not in str(caught.value)


BAD_ACTIONS = {
    "nan": ([0, np.nan, 0, 0], "wheel fr"),
    "inf": ([0, 0, np.inf, 0], "wheel bl"),
    "too large": ([1.01, 0, 0, 0], "1.01 at wheel fl"),
    "too few": ([0, 0, 0], "shape (3,)"),
    "row": ([[0, 0, 0, 0]], "shape (1, 4)"),
    "scalar": (0.5, "shape ()"),
    "text": ("full speed", "numbers"),
    "none": (None, "action"),
}


@pytest.mark.parametrize("case", BAD_ACTIONS)
def test_a_wrong_action_is_one_clear_line_and_moves_nothing(case):
    action, words = BAD_ACTIONS[case]
    env = YouBotTrackingEnv()
    env.reset(seed=0)
    env.step(np.full(4, 0.5))
    before = env.state
    with pytest.raises(InputError) as caught:
        env.step(action)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert np.array_equal(env.state, before)
    *_, info = env.step(np.full(4, 1 + 1e-7))
    assert info["time"] == pytest.approx(0.02) and info["saturated"].all()


def test_wrong_reset_options_are_refused():
    env = YouBotTrackingEnv()
    with pytest.raises(InputError, match="unknown option 'start'"):
        env.reset(options={"start": {}})
    with pytest.raises(InputError, match="Motion"):
        env.reset(options={"reference": 1})
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4))


def test_a_model_file_that_does_not_fit_is_one_clear_line(tmp_path):
    path = tmp_path / "other.json"
    path.write_text('{"schema_version": 99}')
    with pytest.raises(InputError) as caught:
        gym.make("youbot_env:YouBotTracking-v0", model=str(path))
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "order",
    ["import gymnasium, youbot_env", "import youbot_env, gymnasium", "import gymnasium"],
)
def test_made_by_name_in_any_order_of_imports(order):
    code = f"{order}; print(gymnasium.make('youbot_env:YouBotTracking-v0').spec.id)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.stdout.strip() == "YouBotTracking-v0", run.stderr


def test_importing_the_package_stays_light():
    heavy = ("numba", "gymnasium", "sympy", "scipy", "numpy")
    code = f"import sys, youbot_env; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.stdout.strip() == "[]", run.stderr


def test_every_public_name_is_there():
    import youbot_env

    assert set(youbot_env.__all__) <= set(dir(youbot_env))
    for name in youbot_env.__all__:
        assert getattr(youbot_env, name) is not None
    with pytest.raises(AttributeError):
        _ = youbot_env.nonsense  # type: ignore


NAME = "youbot_env:YouBotTracking-v0"


def test_gymnasium_s_own_limit_ends_an_episode_or_is_told_how():
    env = gym.make(NAME, max_episode_steps=5)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4, np.float32))[3] for _ in range(5)]
    assert ends == [False] * 4 + [True]
    with pytest.raises(InputError, match="max_episode_steps: give episode_length, in seconds"):
        gym.make_vec(NAME, 2, vectorization_mode="vector_entry_point", max_episode_steps=5)
