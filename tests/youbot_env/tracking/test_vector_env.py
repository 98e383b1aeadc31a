"""Copies in one compiled control period: equal to single environments to the bit."""

from __future__ import annotations

import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from youbot_env import InputError
from youbot_env.motions.calibration import motion_iii
from youbot_env.simulation.lane_layout import LANES
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_env.tracking.vector_env import INFO_NAMES, YouBotTrackingVectorEnv

NOISY = {
    "wheel_speed_noise": 0.02,
    "encoder_ticks": 4000,
    "delay": 2,
    "action_history": 3,
    "randomise": {"m0": ("80%", "120%"), "aY": ("80%", "120%"), "mu1": (0.08, 0.14)},
    "episode_length": 0.2,
}


def vector(count: int, **options) -> YouBotTrackingVectorEnv:
    found = gym.make_vec(
        "YouBotTracking-v0", count, vectorization_mode="vector_entry_point", **options
    )
    assert isinstance(found, YouBotTrackingVectorEnv)
    return found


def actions_of(copy: int, step: int) -> np.ndarray:
    """The same for a copy whatever the others do."""
    return np.random.default_rng([copy, step]).uniform(-1, 1, 4).astype(np.float32)


def batch_actions(first: int, count: int, step: int) -> np.ndarray:
    return np.array([actions_of(first + copy, step) for copy in range(count)])


@pytest.mark.parametrize("copy", [0, 1, LANES + 1])
def test_a_copy_is_the_single_environment_to_the_bit(copy):
    """Over several episodes, in which reference and model are drawn anew."""
    envs, single = vector(LANES + 2, **NOISY), YouBotTrackingEnv(**NOISY)
    seen, _ = envs.reset(seed=11)
    alone, _ = single.reset(seed=11 + copy)
    assert np.array_equal(seen[copy], alone)
    over, models = False, set()
    for step in range(65):
        seen, reward, terminated, truncated, _ = envs.step(batch_actions(0, LANES + 2, step))
        if over:
            alone, _ = single.reset()
            expected = (0.0, False, False)
        else:
            alone, *expected, _ = single.step(actions_of(copy, step))
        assert np.array_equal(seen[copy], alone)
        assert (reward[copy], terminated[copy], truncated[copy]) == tuple(expected)
        over = bool(expected[1] or expected[2])
        models.add(single.model.values["m0"])
        assert envs.get_attr("parameters")[copy] == single.model.values
    assert len(models) == 4
    assert envs.get_attr("reference")[copy] == single.reference


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_neither_threads_nor_the_number_of_copies_change_a_bit(threads):
    count, first = 6200, 6190
    many, few = vector(count, threads=threads, **NOISY), vector(5, **NOISY)
    assert many.unwrapped._rows._threads == threads
    many.reset(seed=100)
    few.reset(seed=100 + first)
    part = slice(first, first + 5)
    for step in range(45):
        action = np.zeros((count, 4), np.float32)
        action[part] = batch_actions(first, 5, step)
        seen, reward, *ends, _ = many.step(action)
        own, gain, *parts, _ = few.step(action[part])
        assert np.array_equal(seen[part], own) and np.array_equal(reward[part], gain)
        assert np.array_equal(np.array(ends)[:, part], parts)


def test_next_step_autoreset_begins_an_episode_in_the_step_after_its_end():
    envs = vector(2, episode_length=0.03)
    envs.reset(seed=0)
    action = np.zeros((2, 4), np.float32)
    ends, rewards = [], []
    for _ in range(8):
        _, reward, terminated, truncated, info = envs.step(action)
        assert not terminated.any() and info == {}
        ends.append(bool(truncated.all()))
        rewards.append(bool((reward > 0).all()))
    assert ends == [False, False, True, False, False, False, True, False]
    assert rewards == [True, True, True, False, True, True, True, False]


def test_same_step_autoreset_tells_the_last_observation():
    same = vector(3, autoreset_mode="SameStep", info="all", **NOISY)
    single = YouBotTrackingEnv(**NOISY)
    first, _ = same.reset(seed=0)
    single.reset(seed=1)
    for step in range(45):
        seen, reward, _, truncated, info = same.step(batch_actions(0, 3, step))
        alone, gain, _, over, known = single.step(actions_of(1, step))
        assert reward[1] == gain and truncated[1] == over
        if not over:
            assert np.array_equal(seen[1], alone) and "final_obs" not in info
            continue
        assert np.array_equal(info["final_obs"][1], alone) and info["_final_obs"].all()
        assert np.array_equal(info["final_info"]["twist"][1], known["twist"])
        assert info["final_info"]["time"][1] == known["time"]
        alone, known = single.reset()
        assert np.array_equal(seen[1], alone)
        assert info["time"][1] == known["time"] == 0.0
    assert not np.array_equal(first, seen)


def test_disabled_autoreset_waits_for_a_mask():
    envs = vector(4, autoreset_mode=AutoresetMode.DISABLED, episode_length=0.02)
    envs.reset(seed=0)
    action = np.zeros((4, 4), np.float32)
    envs.step(action)
    mask = np.array([True, False, True, False])
    other = envs.step(action)[0][1].copy()
    with pytest.raises(ResetNeeded, match="copy 0"):
        envs.step(action)
    seen, _ = envs.reset(options={"reset_mask": mask})
    assert np.array_equal(seen[1], other)
    with pytest.raises(ResetNeeded, match="copy 1"):
        envs.step(action)
    envs.reset(options={"reset_mask": ~mask})
    envs.step(action)


def test_seeds_and_masks_give_each_copy_its_own_course():
    envs, single = vector(3), YouBotTrackingEnv()
    seen, _ = envs.reset(seed=[7, 5, 9])
    alone, _ = single.reset(seed=5)
    assert np.array_equal(seen[1], alone)
    again, _ = envs.reset(seed=[1, 5, None], options={"reset_mask": np.array([False, True, True])})
    assert np.array_equal(again[0], seen[0]) and np.array_equal(again[1], seen[1])
    assert envs.get_attr("reference")[1] == single.reference
    single.reset()
    envs.reset(seed=None, options={"reset_mask": np.array([False, True, False])})
    assert envs.get_attr("reference")[1] == single.reference
    assert envs.get_attr("reference")[0] != envs.get_attr("reference")[2]


def test_a_given_reference_and_start_are_followed():
    motion, start = motion_iii(), {"twist": (0.1, 0.0, 0.2)}
    envs = vector(2, reference=motion, info=("reference_twist", "twist"))
    _, info = envs.reset(seed=0, options={"initial_state": start})
    assert info["twist"] == pytest.approx(np.array([start["twist"]] * 2))
    *_, info = envs.step(np.zeros((2, 4)))
    assert info["reference_twist"][1] == pytest.approx(motion.twist(0.01))
    envs = vector(2, info=["reference_twist"], episode_length=0.05)
    envs.reset(seed=0, options={"reference": motion, "reset_mask": np.array([True, True])})
    assert envs.get_attr("reference") == (motion, motion)
    *_, info = envs.step(np.zeros((2, 4)))
    assert info["reference_twist"][1] == pytest.approx(motion.twist(0.01))
    for _ in range(10):
        envs.step(np.zeros((2, 4)))


def test_info_is_that_of_the_single_environment():
    envs, single = vector(2, info="all", **NOISY), YouBotTrackingEnv(**NOISY)
    _, info = envs.reset(seed=3)
    _, known = single.reset(seed=4)
    for step in range(5):
        assert set(info) == set(INFO_NAMES) == set(known) - {"parameters", "held"}
        for name in INFO_NAMES:
            if name == "reward_terms":
                found = {key: value[1] for key, value in info[name].items()}
                assert found == known[name]
            else:
                assert np.array_equal(info[name][1], known[name]), name
        *_, info = envs.step(batch_actions(0, 2, step))
        *_, known = single.step(actions_of(1, step))


def test_what_was_handed_out_stays_as_it_was():
    envs = vector(200, info=["twist"])
    seen, _ = envs.reset(seed=0)
    kept: list[tuple[np.ndarray, np.ndarray]] = [(seen, seen.copy())]
    for step in range(6):
        action = np.full((200, 4), 0.1 * step, np.float32)
        seen, reward, terminated, truncated, info = envs.step(action)
        for array in (seen[3:], reward, terminated, truncated, info["twist"]):
            kept.append((array, array.copy()))
        envs.reset(options={"reset_mask": np.arange(200) < 5})
    assert all(np.array_equal(array, before) for array, before in kept)


def test_spaces_and_metadata_are_what_gymnasium_asks_for():
    envs, single = vector(5), YouBotTrackingEnv()
    assert envs.single_action_space == single.action_space
    assert envs.single_observation_space == single.observation_space
    assert envs.observation_space == batch_space(single.observation_space, 5)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, info = envs.reset(seed=0)
    assert envs.observation_space.contains(seen) and info == {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wrapped = gym.wrappers.vector.RecordEpisodeStatistics(vector(5, episode_length=0.05))
        wrapped.reset(seed=0)
        for _ in range(5):
            *_, info = wrapped.step(wrapped.action_space.sample())
    assert info["episode"]["l"].tolist() == [5] * 5


def test_at_most_a_kilobyte_a_copy():
    assert vector(64, encoder_ticks=4000, delay=1).bytes_a_copy <= 1024


def test_a_copy_of_the_vector_goes_on_as_the_original():
    envs = vector(3, **NOISY)
    envs.reset(seed=0)
    twin = pickle.loads(pickle.dumps(envs))
    for step in range(30):
        mine, theirs = envs.step(batch_actions(0, 3, step)), twin.step(batch_actions(0, 3, step))
        assert all(np.array_equal(a, b) for a, b in zip(mine[:4], theirs[:4], strict=True))


BAD = {
    "nan": ([[0, 0, 0, 0], [0, np.nan, 0, 0]], "wheel fr of environment 1"),
    "large": ([[0, 0, 0, 0], [0, 0, 0, -1.1]], "wheel br of environment 1"),
    "shape": ([[0, 0, 0, 0]], "shape (1, 4)"),
    "text": ("full", "numbers"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_action_moves_nothing(case):
    envs, (action, words) = vector(2), BAD[case]
    envs.reset(seed=0)
    before = envs.get_attr("state")
    with pytest.raises(InputError) as caught:
        envs.step(action)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert np.array_equal(before, envs.get_attr("state"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"autoreset_mode": "never"}, "autoreset_mode"),
        ({"info": ("speed",)}, "unknown name 'speed'"),
        ({"threads": 0}, "threads"),
        ({"wheel_noise": 1}, "did you mean 'wheel_speed_noise'"),
        ({"plant": "contact"}, "MuJoCo"),
        ({"num_envs": 0}, "num_envs"),
    ],
)
def test_a_wrong_option_is_one_clear_line(options, words):
    with pytest.raises(InputError) as caught:
        YouBotTrackingVectorEnv(**options)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_any_order_of_calls_is_answered_or_refused():
    """Also what makes no sense; the slow test makes a million."""
    random_calls(3000)


@pytest.mark.slow
def test_a_million_calls_in_any_order():
    random_calls(1_000_000)


WRONG_ACTIONS = (
    np.zeros(4),
    np.zeros((2, 4)),
    np.zeros((3, 5)),
    np.zeros((0, 4)),
    np.zeros((3, 4), complex),
    np.full((3, 4), 1e300),
    "forward",
    None,
    [[0.1] * 4, [0.1] * 4, [0.1]],
)
WRONG_OPTIONS = (
    {"reset_mask": np.zeros(3, np.bool_)},
    {"reset_mask": np.ones(4, np.bool_)},
    {"reset_mask": [True, False, True]},
    {"reset_mask": np.ones(3)},
    {"initial_state": {"twist": (np.nan, 0.0, 0.0)}},
    {"initial_state": {"speed": 1.0}},
    {"reference": "circle"},
    {"seed": 1},
)
WRONG_SEEDS = (-1, [1, 2], 1.5, [1, None, -3], "seed")


def random_calls(count: int) -> None:
    """Calls of vectors and single environments in random order, sensible and not.

    Each is answered within its spaces, or refused by an error that is meant.
    """
    rng, envs, single = np.random.default_rng(0), vector(3), YouBotTrackingEnv()
    meant = (InputError, ResetNeeded, ClosedEnvironmentError, gym.error.Error)
    refused = 0
    for number in range(count):
        if number == 0 or rng.random() < (0.3 if envs.closed else 1e-3):
            options = {"episode_length": 0.05, "dtype": ("float64", "float32")[rng.integers(2)]}
            envs = vector(3, autoreset_mode=list(AutoresetMode)[rng.integers(3)], **options)
            single = YouBotTrackingEnv(**options)
        try:
            one_call(rng, envs, single)
        except meant as error:
            refused += 1
            assert "\n" not in str(error)
    assert 0.1 * count < refused < 0.7 * count


def one_call(rng, envs: YouBotTrackingVectorEnv, single: YouBotTrackingEnv) -> None:
    action = rng.uniform(-1, 1, (3, 4)).astype((np.float32, np.float64)[rng.integers(2)])
    if rng.random() < 0.05:
        action[rng.integers(3), rng.integers(4)] = rng.choice([np.nan, np.inf, -np.inf, 2.0])
    call = rng.random()
    if call < 0.5:
        seen, reward, *_ = envs.step(action)
        assert envs.observation_space.contains(seen)
        assert ((reward >= 0) & (reward <= 1)).all()
    elif call < 0.7:
        seen, reward, *_ = single.step(action[0])
        assert single.observation_space.contains(seen) and 0 <= reward <= 1
    elif call < 0.75:
        wrong = WRONG_ACTIONS[rng.integers(len(WRONG_ACTIONS))]
        (envs if rng.random() < 0.5 else single).step(wrong)
    elif call < 0.80:
        envs.reset(options={"reset_mask": rng.random(3) < 0.4})
    elif call < 0.84:
        (envs if rng.random() < 0.5 else single).reset(
            options=WRONG_OPTIONS[rng.integers(len(WRONG_OPTIONS))]
        )
    elif call < 0.87:
        envs.reset(seed=WRONG_SEEDS[rng.integers(len(WRONG_SEEDS))])
    elif call < 0.95:
        (envs if rng.random() < 0.5 else single).reset(seed=int(rng.integers(100)))
    elif call < 0.996:
        envs.get_attr(("state", "model", "reference", "nothing")[rng.integers(3)])
    elif call < 0.998:
        envs.close()
    else:
        single.close()
