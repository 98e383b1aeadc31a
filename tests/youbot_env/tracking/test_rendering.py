"""What a frame shows: read from its pixels."""

from __future__ import annotations

import pickle
import sys
import time

import gymnasium as gym
import numpy as np
import pytest

from youbot_env import InputError
from youbot_env.physics.geometry import SIGN_LATERAL
from youbot_env.tracking.env import YouBotTrackingEnv

pytest.importorskip("pygame")

from youbot_env.tracking import rendering  # noqa: E402 - it needs pygame


def make(**options):
    env = YouBotTrackingEnv(render_mode="rgb_array", **options)
    env.reset(seed=1)
    return env


def count(frame, color):
    return int((frame == np.array(color)).all(axis=-1).sum())


def view(frame):
    return frame[:, : rendering.VIEW]


def drawn(env):
    frame = env.render()
    assert frame is not None and frame.shape == (640, 960, 3) and frame.dtype == np.uint8
    return frame


def test_needs_no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    assert len(np.unique(drawn(make()).reshape(-1, 3), axis=0)) > 10


def test_torque_bars_grow_with_the_torque_and_turn_red_at_the_limit():
    areas = {}
    for size in (0.3, 0.9, 1.0, -0.9):
        env = make()
        env.step(np.full(4, size))
        frame = view(drawn(env))
        areas[size] = [
            count(frame, color)
            for color in (rendering.FORWARD, rendering.BACKWARD, rendering.LIMIT)
        ]
    assert areas[0.9][0] > 2 * areas[0.3][0] > 0
    assert areas[-0.9][1] > 0 and areas[-0.9][0] == 0
    assert areas[1.0][2] > 0 and areas[1.0][0] == 0 and areas[0.9][2] == 0


def test_velocity_arrow_grows_with_the_speed():
    areas = []
    for speed in (0.1, 0.5):
        env = make(initial_state={"twist": (speed, 0.0, 0.0)})
        areas.append(count(view(drawn(env)), rendering.TRUE))
    assert areas[1] > 2 * areas[0]


def test_rollers_slant_outwards_from_the_centre_and_move_with_the_wheel():
    for wheel, slant in zip(range(4), (1, -1, -1, 1), strict=True):
        still = rendering._stripes(1.0, -SIGN_LATERAL[wheel], 0.3)
        run = np.diff(still, axis=1)[:, 0]
        assert run[:, 1] / run[:, 0] == pytest.approx(np.full(len(run), slant))
        turned = rendering._stripes(1.0, -SIGN_LATERAL[wheel], 0.35)
        assert (turned.mean(axis=1)[:, 0] > still.mean(axis=1)[:, 0]).all()


def test_trail_shows_where_it_has_been():
    env = make()
    before = count(view(drawn(env)), rendering.TRUE)
    for force in (0.5, 0.0):
        for _ in range(150):
            env.step(force * np.array([-1.0, 1.0, 1.0, -1.0]))
    assert count(view(drawn(env)), rendering.TRUE) > before + 50
    env.reset(seed=1)
    assert count(view(drawn(env)), rendering.TRUE) == before


def test_every_moment_can_be_drawn():
    env = make(episode_length=1.0, initial_state={"pose": (1e3, -1e3, 7.0)})
    rng, frames = np.random.default_rng(0), set()
    truncated = False
    while not truncated:
        *_, truncated, _ = env.step(rng.uniform(-1, 1, 4))
        frames.add(drawn(env).tobytes())
    assert len(frames) == 100


def test_frames_handed_out_stay_as_they_were():
    env = make()
    first = drawn(env)
    kept = first.copy()
    env.step(np.ones(4))
    drawn(env)
    assert np.array_equal(first, kept)


def test_human_mode_keeps_to_its_frame_rate_and_closes(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    env = gym.make("YouBotTracking-v0", render_mode="human", control_rate=20.0)
    assert env.metadata["render_fps"] == 20
    env.reset(seed=0)
    start = time.perf_counter()
    for _ in range(10):
        env.step(np.zeros(4, np.float32))
    assert time.perf_counter() - start > 0.4
    assert pygame.display.get_init()
    env.close()
    assert not pygame.display.get_init()
    env.close()
    env.reset(seed=0)
    env.close()


def test_a_rendering_environment_can_be_pickled():
    env = make()
    env.step(np.ones(4))
    drawn(env)
    twin = pickle.loads(pickle.dumps(env))
    assert np.array_equal(drawn(env), drawn(twin))


def test_without_pygame_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(InputError, match=r'pip install "youbot\[render\]"'):
        YouBotTrackingEnv(render_mode="rgb_array")
    YouBotTrackingEnv().reset(seed=0)


def test_render_before_reset_and_without_a_mode_say_what_to_do():
    with pytest.raises(InputError, match="reset"):
        YouBotTrackingEnv(render_mode="rgb_array").render()
    with pytest.warns(UserWarning, match="render_mode"):
        assert YouBotTrackingEnv().render() is None
