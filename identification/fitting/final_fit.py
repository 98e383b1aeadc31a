"""The last fit of a structure: no bias by noise on the speeds, and an interval that holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from identification.fitting.errors import NoiseLevel
from identification.fitting.held_channels import doubt_of_held
from identification.fitting.least_squares import Fit
from identification.fitting.noise_bias import Array, extrapolated_fit, joint_fit
from identification.fitting.physical_fit import within_limits
from identification.fitting.settings import FitSettings
from identification.fitting.twins import doubt_between_twins
from identification.logs.findings import names_of
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from youbot_env.errors import InputError


def final_fit(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    noise: Sequence[NoiseLevel],
    start: Array,
    seed: int,
    settings: FitSettings = FitSettings(),
) -> Fit:
    """Fit of all parameters that the data determine, shape constants included.

    Shape constants that a search has found (a Stribeck speed, a time constant) are fitted together
    with the other parameters, so that the covariance contains their uncertainty too.

    Parameters
    ----------
    start : (P,) result of the search
    noise : of each log
    seed : of the noise that is added to measure its effect
    """
    found = joint_fit(mechanism, samples, start, settings)
    return without_noise_bias(mechanism, samples, noise, found, seed, settings)


def without_noise_bias(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    noise: Sequence[NoiseLevel],
    found: Fit,
    seed: int,
    settings: FitSettings = FitSettings(),
    progress: Callable[[], None] = lambda: None,
) -> Fit:
    """A force fit without the bias by noise on the speeds, and with what the free run says of it.

    Where the bias is small it is extrapolated away. Speeds that are differences of counted angles,
    and speeds whose noise shifts the fit by more than the stated deviations, leave more bias than
    that can remove: there the free run is fitted, into which no measured speed enters.

    Otherwise both fits estimate the same. What they differ by beyond chance is added to the
    covariance: it is there where the model is not true. So is what efforts that are held for some
    rows leave open, and how parameters that act alike share what they make. The parameters are
    within the limits of what can be.
    """
    doubt = doubt_of_held(mechanism, samples, found.theta, found.free, settings)
    last = _last_fit(mechanism, samples, noise, found, seed, settings, progress)
    widened = replace(last, covariance=last.covariance + doubt)
    inside = within_limits(mechanism, widened, settings)
    shared = doubt_between_twins(mechanism, inside, settings)
    return replace(inside, covariance=inside.covariance + shared)


def _last_fit(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    noise: Sequence[NoiseLevel],
    found: Fit,
    seed: int,
    settings: FitSettings,
    progress: Callable[[], None],
) -> Fit:
    """The fit without bias by noise, of force or free run, that may be beyond physical limits."""
    counted = any(item.angle_noise is not None for item in samples)
    undone = found
    if not counted:
        undone = extrapolated_fit(mechanism, samples, noise, found, seed, settings)
    run = _fit_of_free_run(mechanism, samples, undone, settings, progress)
    if run is None:
        return undone
    shift = np.abs(undone.theta - found.theta)[found.free]
    if counted or (shift > settings.max_noise_shift * found.std).any():
        return run
    beyond = _beyond_chance(undone, run)
    return replace(undone, covariance=undone.covariance + np.outer(beyond, beyond))


def _beyond_chance(one: Fit, other: Fit) -> Array:
    """(F,) by what two fits of the same parameters differ, less what noise alone makes of it.

    Where the model is true, and one of two estimates makes the most of the data, the variance of
    their difference is the difference of their variances (Hausman, Econometrica 46(6), 1978). So
    much is taken from its square, but no more than the first one's own variance: what a model
    lacks may make the other's many times as large. On true models the whole difference made
    intervals of 95 % hold 98 %.
    """
    apart = (other.theta - one.theta)[one.free]
    variance = np.diag(one.covariance)
    chance = np.minimum(np.abs(np.diag(other.covariance) - variance), variance)
    return np.sign(apart) * np.sqrt(np.maximum(apart**2 - chance, 0.0))


def _fit_of_free_run(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    start: Fit,
    settings: FitSettings,
    progress: Callable[[], None],
) -> Fit | None:
    """The output-error fit; None where a free run says nothing or cannot be made."""
    if mechanism.structure.depends_on_angle:
        # A free run loses the wheels' phase, on which a ripple depends.
        return None
    if any(mechanism.labels[k].parameter.instant for k in start.free):
        # It goes from sample to sample, so an instant between two of them changes nothing.
        return None
    # Imported here: it loads numba, which takes half a second and which a force fit does not need.
    from identification.fitting.output_error import refine

    try:
        run = refine(mechanism, samples, start, settings=settings, progress=progress)
    except InputError:
        return None
    inside = np.isfinite(run.theta).all() and np.isfinite(run.covariance).all()
    return run if inside else None


def coarse_speed_warnings(samples: Sequence[Samples], fitted: Fit) -> list[str]:
    """What was done about speeds that are differences of counted angles; one line for all logs."""
    coarse = [item for item in samples if item.angle_noise is not None]
    if not coarse:
        return []
    step = max(_step_of(item) for item in coarse)
    noise = max(max(item.angle_noise or (0.0,)) / item.dt for item in coarse)
    size = f"come in steps of {step:.3g} rad/s" if step else f"are rough by {noise:.2g} rad/s"
    slow = min(item.bandwidth for item in coarse)
    done = ["taken as the mean since the row before"]
    if np.isfinite(slow):
        done.append(f"smoothed to {slow:.2g} Hz, as the torques are")
    if fitted.in_free_run:
        done.append("kept out of the columns: the free run is fitted (output error)")
    return [
        f"{names_of([item.name for item in coarse])}: the speeds {size}, as differences of counted "
        f"angles do: {'; '.join(done)}. Differences over longer are finer"
    ]


def _step_of(samples: Samples) -> float:
    """Step [rad/s] of the speeds of a log; 0 if they have none."""
    # Samples hold means of two neighbours, which come in half steps.
    apart = np.diff(np.unique(np.abs(samples.wheel_speed)))
    # Less than a thousandth of the fastest is the rounding of a file.
    apart = apart[apart > 1e-3 * np.abs(samples.wheel_speed).max()]
    few = 0 < len(apart) < 0.1 * samples.wheel_speed.size
    return 2.0 * float(np.median(apart)) if few else 0.0
