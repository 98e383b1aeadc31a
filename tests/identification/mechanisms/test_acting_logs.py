"""An effect that acts in some logs only: strength, columns and free run are zero in the others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.mechanisms.registry import mechanism_of
from identification.mechanisms.samples import cut
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.files import read_bytes
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model, save_model

SAMPLES = cut(mechanism_of(load_model("paper")).samples(recording("I")), 0, 400)
HERE, THERE = replace(SAMPLES, name="here"), replace(SAMPLES, name="there")


def sloped(**logs: tuple[str, ...]) -> Model:
    model = load_model("paper").with_effect("floor_tilt", tilt_x=0.02, tilt_y=0.01)
    return replace(model, effect_logs=logs)


def test_it_acts_where_it_is_said_to():
    level, everywhere = load_model("paper"), sloped()
    some = sloped(floor_tilt=("here",))
    for samples, like in ((HERE, everywhere), (THERE, level)):
        mechanism, other = mechanism_of(some), mechanism_of(like)
        np.testing.assert_array_equal(
            mechanism.demand(some.theta, samples).force, other.demand(like.theta, samples).force
        )
        np.testing.assert_allclose(
            mechanism.free_run(some.theta, samples),
            other.free_run(like.theta, samples),
            atol=1e-12,
        )


def test_columns_are_zero_where_it_does_not_act():
    some = sloped(floor_tilt=("here",))
    mechanism = mechanism_of(some)
    columns = {
        samples.name: mechanism.demand(some.theta, samples).columns([0, 7, 8])
        for samples in (HERE, THERE)
    }
    assert all(column.any() for column in columns["here"])
    assert not columns["there"][1:].any() and columns["there"][0].any()


def test_one_effect_at_two_strengths():
    """A slope one way in one log, another way in the other: two instances."""
    base = mechanism_of(load_model("paper"))
    twice = base.extended("floor_tilt@1", ["here"]).extended("floor_tilt@2", ["there"])
    theta = np.concatenate([load_model("paper").theta, [0.02, 0.0], [-0.02, 0.0]])
    for samples, tilt in ((HERE, 0.02), (THERE, -0.02)):
        one = load_model("paper").with_effect("floor_tilt", tilt_x=tilt)
        np.testing.assert_allclose(
            twice.free_run(theta, samples), mechanism_of(one).free_run(one.theta, samples)
        )
    assert twice.plain_names == {"floor_tilt@1": "floor_tilt", "floor_tilt@2": "floor_tilt@2"}
    assert twice.with_effects(["floor_tilt@2"]).acts_in == {"floor_tilt@2": frozenset(["there"])}


def test_a_model_file_keeps_the_logs(tmp_path: Path):
    path = tmp_path / "model.json"
    save_model(path, sloped(floor_tilt=("here", "at noon")))
    again = load_model(path)
    assert again.effect_logs == {"floor_tilt": ("here", "at noon")}
    assert mechanism_of(again).acts_in == {"floor_tilt": frozenset(["here", "at noon"])}
    assert again.without_effects().effect_logs == {}


@pytest.mark.parametrize("logs", ["[]", '"here"', "[1]"])
def test_logs_that_cannot_be_are_refused(tmp_path: Path, logs: str):
    path = tmp_path / "model.json"
    save_model(path, sloped(floor_tilt=("here",)))
    text = read_bytes(str(path), 10**6, str).decode()
    start, end = text.index('"logs": ['), text.index("]", text.index('"logs": [')) + 1
    path.write_text(text[:start] + f'"logs": {logs}' + text[end:])
    with pytest.raises(InputError, match="logs"):
        load_model(path)
