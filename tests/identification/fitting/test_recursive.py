import numpy as np

from identification.fitting.least_squares import fit
from identification.fitting.recursive import RecursiveLeastSquares, recursive_course
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")


def test_equals_batch_least_squares_with_its_prior():
    rng = np.random.default_rng(0)
    columns, measured = rng.standard_normal((200, 3, 4)), rng.standard_normal((200, 3))
    estimator = RecursiveLeastSquares(4, start=np.ones(4), variance=2.0)
    for h, z in zip(columns, measured, strict=True):
        estimator.update(h, z)
    flat, right = columns.reshape(-1, 4), measured.ravel()
    information = flat.T @ flat + np.eye(4) / 2.0
    expected = np.linalg.solve(information, flat.T @ right + np.ones(4) / 2.0)
    np.testing.assert_allclose(estimator.estimate, expected, atol=1e-12)
    np.testing.assert_allclose(estimator.covariance, np.linalg.inv(information), atol=1e-12)


def test_forgetting_follows_a_parameter_that_changes():
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((600, 1, 1))
    truth = np.where(np.arange(600) < 300, 1.0, 2.0)
    faithful, forgetful = RecursiveLeastSquares(1), RecursiveLeastSquares(1, forgetting=0.95)
    for h, value in zip(columns, truth, strict=True):
        faithful.update(h, h[:, 0] * value)
        forgetful.update(h, h[:, 0] * value)
    assert abs(forgetful.estimate[0] - 2.0) < 1e-3 < abs(faithful.estimate[0] - 2.0)


def test_the_papers_round_gives_its_numbers_back():
    """I - III - II - IV, 140 s, stock control: within three deviations, and on the batch fit."""
    engine = Mecanum(Geometry(), mecanum_structure())
    samples = engine.samples(recording())
    batch = fit(engine, [samples], PAPER.theta)
    course = recursive_course(batch.rows, batch.theta, engine.scale, batch.std)
    assert samples.time[-1] > 139
    assert (np.abs(course.theta[-1] - PAPER.theta) < 3 * course.std[-1]).all()
    assert (np.abs(course.theta[-1] - batch.theta) < 1 * batch.std).all()
    np.testing.assert_allclose(course.std[-1], batch.std)
    assert (np.diff(course.time) > 0).all() and course.time[-1] <= samples.time[-1] + 1e-9
    # Uncertainty only ever falls, and the early estimates are the worse ones.
    assert (np.diff(course.std, axis=0) <= 1e-12).all()
    assert (course.std[len(course.std) // 4] > 1.2 * course.std[-1]).all()
