"""Effects on torques and forces: planted in a recording, named beside their rivals, and sized."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.recording import record
from identification import identify
from identification.comparison import _clock_of
from identification.diagnosis.candidates import fit_base, rank
from identification.diagnosis.diagnose import select
from identification.diagnosis.sentences import WORDS, describe
from identification.diagnosis.structures import LoggedData
from identification.fitting.errors import SumsOfSquares, force_traces
from identification.fitting.final_fit import final_fit
from identification.logs.log import Log, starts_on_shared_clock
from identification.mechanisms.physical_parameters import fitted_model
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from tests.youbot_env.structures import EFFECTS, catalogue_values
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import CATALOGUE

PAPER = load_model("paper")
RNG = np.random.default_rng

RIVALS = ["floor_tilt", "wheel_coulomb_friction", "uneven_wheel_friction", "torque_gain_error"]

PLANTED = [
    ("torque_offset", {"offset_fl": 0.06, "offset_fr": 0.02, "offset_bl": -0.04}),
    ("torque_constant_drift", {"fraction": 0.2, "time_constant": 50.0}),
    ("speed_dependent_gain", {"loss": 0.15}),
    ("torque_saturation", {"limit": 0.6}),
    ("dead_zone", {"width": 0.08}),
    ("drive_resonance", {"frequency": 25.0, "damping": 0.4}),
    (
        "torque_ripple",
        {
            "amplitude": 0.2,
            "phase_fl": 0.5,
            "phase_fr": -2.0,
            "phase_bl": 1.0,
            "phase_br": 2.5,
            "cycles": 6.0,
        },
    ),
    ("uneven_coulomb_friction", {"extra_fr": 0.2}),
    ("uneven_roller_friction", {"extra_bl": 0.05}),
    ("asymmetric_friction", {"coulomb": 0.08, "viscous": 0.02}),
    ("yaw_scrub", {"torque": 2.0}),
    ("cable_drag", {"force": 6.0}),
    ("cable_twist", {"stiffness": 0.6, "neutral": 0.4}),
]


@pytest.mark.parametrize(
    ("name", "values"),
    [*PLANTED[:3], *(pytest.param(*case, marks=pytest.mark.slow) for case in PLANTED[3:])],
)
def test_a_planted_effect_is_named_and_sized(name: str, values: dict[str, float]):
    log = recording(effects=((name, tuple(values.items())),), rate=50.0)
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [log])
    names = [name, *RIVALS]
    found = select(data, mechanism, PAPER.theta, names, np.random.default_rng(0))
    assert [step.effect for step in found.steps[1:]] == [name]
    last = found.steps[-1].fitted
    args = (last.mechanism, data.samples, data.noise, last.theta, 0, data.settings.fit)
    model = fitted_model(last.mechanism, final_fit(*args))
    for key, value in seen(name, values).items():
        estimate = model.effects[name][key]
        deviation = estimate.std or 0.2 * abs(value)
        assert abs(estimate.value - value) < max(4 * deviation, 0.03 * abs(value)), key


def test_a_limit_that_cuts_most_torques_is_found():
    """It acts in few blocks of time, and what it takes is more than what acts."""
    limit = ("torque_saturation", (("limit", 0.5),))
    log = recording(effects=(limit, ("floor_tilt", (("tilt_x", 0.01),))), rate=50.0)
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [log])
    ranking = rank(data, fit_base(data, mechanism, PAPER.theta), [limit[0], *RIVALS], RNG())
    assert ranking.best is not None and ranking.best.name == limit[0]
    assert ranking.p_values[limit[0]] <= 0.01
    place = ranking.best.mechanism.parameter_names.index("torque_saturation.limit")
    assert ranking.best.theta[place] == pytest.approx(0.5, rel=0.25)
    assert ranking.best.acting_share < 0.5


def seen(name: str, values: dict[str, float]) -> dict[str, float]:
    """What a log can show of planted values: none that cancel on the platform.

    Rollers of the two front wheels turn at one speed, and so do those of the back ones.
    """
    hidden = {
        "torque_offset": np.array([[1.0, 1.0, -1.0, -1.0]]) / 2,
        "uneven_roller_friction": np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
        / np.sqrt(2.0),
    }
    if name not in hidden:
        return values
    keys = CATALOGUE[name].public_names[:4]
    planted = np.array([values.get(key, 0.0) for key in keys])
    internal = hidden[name]
    return dict(zip(keys, planted - internal.T @ (internal @ planted), strict=True))


@pytest.mark.parametrize("name", [name for name in EFFECTS if name in WORDS])
def test_a_sentence_holds_the_size_and_how_to_confirm_it(name: str):
    base = {key: entry.value for key, entry in PAPER.parameters.items()}
    sentence = describe(CATALOGUE[name], catalogue_values(name), base)
    assert any(digit.isdigit() for digit in sentence)
    assert "to confirm" in sentence or name == "payload_change"


def session(values: dict[str, float], *starts: float) -> list[Log]:
    """Logs of one platform that begin at these times of a session."""
    motions = [multisine(np.random.default_rng(k), name=f"run_{k}") for k in range(len(starts))]
    made = []
    for motion, start in zip(motions, starts, strict=True):
        # The recorder's clock is that of the run: what has fallen since is a share of all torques.
        fraction, constant = values["fraction"], values["time_constant"]
        (log,) = record(PAPER, [motion], rate=50.0, seed=1)
        factor = 1 - fraction * (1 - np.exp(-(start + log.time - log.time[0]) / constant))
        made.append(replace(log, time=log.time + start, effort=log.effort / factor[:, None]))
    return made


def test_a_drift_goes_on_over_a_session_and_into_logs_that_come_later():
    values = {"fraction": 0.2, "time_constant": 80.0}
    *fitted, later = session(values, 5.0, 90.0, 200.0)
    start = PAPER.with_effect("torque_constant_drift", time_constant=80.0)
    found = identify(fitted, start=start, recursive=False).model
    assert found.values["torque_constant_drift.fraction"] == pytest.approx(0.2, abs=0.02)
    clock, of_clock = _clock_of(found)
    assert clock == {"start": pytest.approx(5.02), "end": pytest.approx(150.0)}
    mechanism = mechanism_of(found)
    errors = []
    for known in (clock, None):
        (samples,) = mechanism.samples_of([later], known, of_clock)
        errors.append(SumsOfSquares.of(force_traces(mechanism, found.theta, samples)).ratio)
    assert errors[0] < 0.3 * errors[1]
    assert _clock_of(replace(found, provenance={"clock": {"start": "yesterday"}}))[0] is None


def test_logs_that_overlap_share_no_clock():
    log = recording(rate=50.0)
    later = replace(log, time=log.time + 500.0)
    assert starts_on_shared_clock([log, later]) == [0.0, pytest.approx(500.0)]
    assert starts_on_shared_clock([log, replace(log, time=log.time + 1.0)]) == [0.0, 0.0]
    clock = {"start": -20.0, "end": -10.0}
    assert starts_on_shared_clock([later], clock)[0] == pytest.approx(later.time[0] + 20.0)
    assert starts_on_shared_clock([later], {"start": 0.0, "end": 600.0}) == [0.0]
