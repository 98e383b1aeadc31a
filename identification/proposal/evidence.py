"""What logs say of a law on top of a fitted structure: its columns, and sums of them over blocks.

All that the search asks (the fall of squares on stretches that were held out, scores for the
bootstrap, the confirmation) follows from products of columns summed over blocks of time. A law is
evaluated once for each choice of its shape constants, at the logs' own samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.proposal.law import FoundLaw, Law
from identification.proposal.settings import ProposalSettings
from identification.signals.filters import block_mean, hold_weights, pieces, settled
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import Effect
from youbot_env.physics.mechanism import EffectPoints, Instant, component_force

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Scene:
    """One log as laws see it: the points at which they act, and the way from a force to rows.

    ``step``: [s] from one row to the next; ``settling``: the filter's time constants until its
    start is forgotten.
    """

    def __init__(
        self,
        mechanism: Mechanism[Any],
        theta: Array,
        samples: Samples,
        step: float,
        settling: float,
        settings: ProposalSettings,
    ) -> None:
        self.mechanism = mechanism
        s = samples.for_fit
        self.size = round(step / s.dt)
        self.first = settled(mechanism.filter_rate, s.dt, settling)
        self.thin = _thin(self.size, s.dt, settings.node_step)
        self._most = settings.max_samples_at_once
        demand = mechanism.demand(theta, s)
        # What acts at the samples that laws are evaluated at: each ``thin``-th, so that one of them
        # is that at which the rows begin.
        kept = slice(self.first % self.thin, None, self.thin)
        s = demand.samples
        means = [0.5 * (ends[0] + ends[1]) for ends in demand.joint_torque]
        torque = tuple(np.concatenate([part[:1], part])[kept] for part in means)
        rolling = dynamics.rolling_geometry(np, mechanism.structure, mechanism.geometry, theta)
        self.torque = np.stack(torque, axis=1)
        acceleration = np.gradient(s.twist, s.dt, axis=0)[kept]
        self.time, self.twist, self.pose = s.time[kept], s.twist[kept], s.pose[kept]
        self.angle, self.wheel_speed = s.wheel_angle[kept], s.wheel_speed[kept]
        structure = mechanism.structure

        def points_of(some: slice) -> EffectPoints:
            channels = (self.twist, acceleration, self.pose, self.angle, self.torque)
            twist, rates, pose, angle, acting = (tuple(part[some].T) for part in channels)
            at = Instant(twist, rates, pose, angle, acting, time=self.time[some], start=s.start)
            return EffectPoints(np, structure.mechanism, rolling, theta, at, structure.carriers)

        self.points = [points_of(some) for some in pieces(len(self.time), self._most)]
        self.decay, *self.weights = hold_weights(mechanism.filter_rate, self.thin * s.dt)
        self.moves = None if s.moves is None else s.moves[kept].astype(float)

    def force(self, effect: Effect, values: Sequence[float], joint: int | None = None) -> Array:
        """(N, A) force of an effect at the samples, in the units of a fit."""
        return np.concatenate([self._force(at, effect, values, joint) for at in self.points])

    def _force(
        self, at: EffectPoints, effect: Effect, values: Sequence[float], joint: int | None
    ) -> Array:
        """The same at some of the samples."""
        parts = component_force(effect, values, at, joint)
        shape = np.shape(at.at.time)
        return np.stack(
            [np.broadcast_to(p, shape) * k for p, k in zip(parts, self.scale, strict=True)], axis=1
        )

    @cached_property
    def scale(self) -> Array:
        """(A,) factors from a generalised force."""
        return self.mechanism.force_scale

    def columns(self, effect: Effect, units: Sequence[tuple[Sequence[float], int | None]]) -> Array:
        """(n, A, q) rows of an effect's force with each of q values, at each one's joint.

        Made piece by piece: forces and what the filter makes of them on its way are several times
        as large as the rows, and those of an hour took 200 MB in each thread.
        """
        return self._rows(
            np.stack([self._force(at, effect, v, joint) for v, joint in units], axis=-1)
            for at in self.points
        )

    def rows(self, force: Array) -> Array:
        """(n, ...) rows of a force (N, ...) at the samples: filtered, then means."""
        return self._rows(force[some] for some in pieces(len(force), self._most))

    def _rows(self, forces: Iterable[Array]) -> Array:
        """The same of a force that comes piece by piece."""
        filtered = np.concatenate(list(self._filtered(forces)))[self.first // self.thin :]
        # The mean over each ``thin``-th sample of a row lies this much earlier than that over all.
        early, size = (self.thin - 1) / (2 * self.thin), self.size // self.thin
        if not early:
            return block_mean(filtered, size)
        count = (len(filtered) - 1) // size
        found = np.empty((count, *filtered.shape[1:]))
        for some in pieces(count, max(1, self._most // size)):
            part = filtered[some.start * size : some.stop * size + 1]
            found[some] = block_mean((1.0 - early) * part[:-1] + early * part[1:], size)
        return found

    def _filtered(self, forces: Iterable[Array]) -> Iterator[Array]:
        """A force behind the filter, piece by piece: each goes on where the last one ended."""
        from scipy.signal import lfilter  # half a second, which a diagnosis may do without

        last: Array | None = None
        state: Array | None = None
        for force in forces:
            if last is None or state is None:
                # From zero at the first sample.
                state = np.zeros((1, *force.shape[1:]))
                yield state
            else:
                force = np.concatenate([last, force])
            steps = self.weights[0] * force[:-1] + self.weights[1] * force[1:]
            found, state = lfilter([1.0], [1.0, -self.decay], steps, axis=0, zi=state)
            last = force[-1:]
            yield found

    def back(self, rows: Array) -> Array:
        """(N, ...) at the samples: the transpose of :meth:`rows`, for scans over periods."""
        from scipy.signal import lfilter

        out = np.zeros((len(self.time), *rows.shape[1:]))
        size = self.size // self.thin
        spread = np.repeat(rows, size, axis=0) / size
        start = self.first // self.thin
        stop = min(start + len(spread), len(out))
        out[start:stop] = spread[: stop - start]
        return np.asarray(lfilter([1.0 - self.decay], [1.0, -self.decay], out[::-1], axis=0))[::-1]


def _thin(size: int, dt: float, most: float) -> int:
    """Which samples laws are evaluated at: each so-manieth, of those that make a row."""
    parts = [k for k in range(1, size + 1) if size % k == 0 and k * dt <= most * (1 + 1e-9)]
    return max(parts, default=1)


@dataclass(frozen=True)
class Sums:
    """Products of a law's columns (q) by block (b): with each other, with the structure's (F), with
    the residual."""

    own: Array
    cross: Array
    side: Array

    def of(self, which: Mask) -> tuple[Array, Array, Array]:
        """The three, summed over some blocks."""
        return self.own[which].sum(0), self.cross[which].sum(0), self.side[which].sum(0)


class Folds(NamedTuple):
    """Of each fold (f) which blocks it is fitted and judged on, and the structure's sums there:
    inverse, right side and step of the former; products, right side and squares of the latter."""

    known: Array
    held: Array
    inverse: Array
    side: Array
    step: Array
    gram: Array
    held_side: Array
    square: Array


def _solved_alike(left: Array, right: Array, own: Array) -> Array:
    """(f, q) solutions of normal equations (f, q, q); what the structure absorbs stays at zero."""
    size = np.maximum(np.diagonal(own, axis1=1, axis2=2), 1e-300)
    gone = np.diagonal(left, axis1=1, axis2=2) <= MIN_LEFT * size
    scale = np.where(gone, 1.0, np.sqrt(size))
    matrix = left / (scale[:, :, None] * scale[:, None, :])
    matrix = np.where(gone[:, :, None] | gone[:, None, :], 0.0, matrix)
    identity = np.eye(own.shape[1])
    # A trace of ridge, so that columns which are alike have a solution.
    matrix = matrix + identity * np.where(gone, 1.0, RIDGE)[:, :, None]
    side = np.where(gone, 0.0, right / scale)
    return np.linalg.solve(matrix, side[..., None])[..., 0] / scale


class Evidence:
    """Residual and columns of a fitted structure by block of time, and what laws add to it.

    Parameters
    ----------
    residual, columns : per log (n, A) and (n, A, Q) of the structure, in directions that data can
        see; step : from one row to the next [s], per log
    settling : time constants of the filter until its start is forgotten
    seed : of which stretches the search sees
    stretch_blocks : of time, that are seen or not seen together
    """

    def __init__(
        self,
        mechanism: Mechanism[Any],
        theta: Array,
        samples: Sequence[Samples],
        residual: Sequence[Array],
        columns: Sequence[Array],
        step: Sequence[float],
        settling: float,
        seed: int,
        settings: ProposalSettings,
        stretch_blocks: int,
    ) -> None:
        self.stretch_blocks = stretch_blocks
        self.mechanism, self.theta, self.settings = mechanism, theta, settings
        self.scenes = [
            Scene(mechanism, theta, item, of_log, settling, settings)
            for item, of_log in zip(samples, step, strict=True)
        ]
        self.residual = list(residual)
        self.length = max(1, round(settings.block_time / step[0]))
        self.counts = [(len(part) - 1) // self.length for part in residual]
        self.target = self._blocked([r[..., None] for r in self.residual])
        self.base = self._blocked(columns)
        self.base = self.base / np.maximum(np.sqrt((self.base**2).sum((0, 1))), 1e-300)
        self.stretch = self._stretches()
        self.unseen, self.fold = self._dealt(seed)
        self.square = (self.target**2).sum((1, 2))
        self._transposed = np.swapaxes(self.base, 1, 2)
        self.gram = self._transposed @ self.base
        self.base_side = (self._transposed @ self.target)[..., 0]

    # Blocks -------------------------------------------------------------------------------------

    def _blocked(self, columns: Sequence[Array]) -> Array:
        """(blocks, rows * axes, q) of columns (n, A, q) per log."""
        # A row at the end of a log may be lost to thinning, and counts for nothing then.
        parts = [
            c[: count * self.length].reshape(count, -1, c.shape[-1])
            for c, count in zip(columns, self.counts, strict=True)
        ]
        return np.concatenate(parts)

    def _stretches(self) -> NDArray[np.intp]:
        """(blocks,) number of the stretch that a block lies in."""
        found, first = [], 0
        for count in self.counts:
            of_log = np.arange(count) // self.stretch_blocks
            found.append(first + of_log)
            first += int(of_log[-1]) + 1 if count else 0
        return np.concatenate(found)

    def _dealt(self, seed: int) -> tuple[Mask, NDArray[np.intp]]:
        """(blocks,) whether the search does not see a block, and the fold that it is in."""
        stretches = int(self.stretch.max()) + 1
        order = np.random.default_rng(seed).permutation(stretches)
        hidden = order < round(self.settings.unseen_share * stretches)
        return hidden[self.stretch], (order % self.settings.folds)[self.stretch]

    @cached_property
    def seen(self) -> Mask:
        """(blocks,) that the search sees."""
        return ~self.unseen

    def loud_places(self) -> tuple[Array, Array]:
        """Places (n, 2) [m] that the logs pass where the search sees them, and the squares (n,)
        that the structure leaves there."""
        step = self._own_seen[1]
        left = ((self.target[..., 0] - self.base @ step) ** 2) * self.seen[:, None]
        places, squares, start = [], [], 0
        for scene, residual, count in zip(self.scenes, self.residual, self.counts, strict=True):
            rows = left[start : start + count].reshape(-1, residual.shape[1]).sum(axis=1)
            start += count
            size = scene.size // scene.thin
            at = scene.first // scene.thin + size * np.arange(len(rows))
            places.append(scene.pose[at][:, :2])
            squares.append(rows)
        return np.concatenate(places), np.concatenate(squares)

    def taken_back(self) -> list[Array]:
        """Per log (N, A) what the structure leaves where the search sees, taken back through the
        filter: what it has in common with a force at the samples is that with the force's rows."""
        left = (self.target[..., 0] - self.base @ self._own_seen[1]) * self.seen[:, None]
        found, start = [], 0
        for scene, residual, count in zip(self.scenes, self.residual, self.counts, strict=True):
            rows = left[start : start + count].reshape(-1, residual.shape[1])
            found.append(scene.back(rows) * self.mechanism.force_scale)
            start += count
        return found

    def fitted(self, sums: Sums) -> float:
        """Squares that a law leaves of all stretches, fitted to them all."""
        everything = np.ones(len(self.seen), bool)
        inverse, _ = self._own(everything)
        strength, step = self._solved(sums, everything, inverse)
        return float(self._left(sums, everything, step, strength).sum())

    # Laws ---------------------------------------------------------------------------------------

    def columns(self, trial: Trial, values: Sequence[float]) -> list[Array]:
        """Per log (n, A, q) a law's columns at some values of its shape constants.

        Of a law on a clock of its own each log has its own ones (n, A, logs * q), and those of the
        others are zero there: where in its period a log began is a number of the log.
        """
        found, units = [], trial.units(values)
        for number, scene in enumerate(self.scenes):
            rows = scene.columns(trial.effect, units)
            if self.logs_apart(trial.law):
                alone = np.zeros((*rows.shape[:2], len(self.scenes), rows.shape[2]))
                alone[:, :, number] = rows
                rows = alone.reshape(*rows.shape[:2], -1)
            found.append(rows)
        return found

    def logs_apart(self, law: Law) -> int:
        """How many logs have a number of their own that says when they began on a law's clock: all
        but one, since the first may be where that clock begins."""
        count, on_common_clock = len(self.scenes), self.mechanism.structure.reads_start
        apart = law.own_clock and not on_common_clock and count <= self.settings.max_logs_apart
        return count - 1 if apart else 0

    def values_of(self, trial: Trial, shapes: Sequence[float], strength: Array) -> FoundLaw:
        """A law with these constants; of one whose logs have their own strengths, those of the log
        that shows most of it."""
        if self.logs_apart(trial.law):
            each = strength.reshape(len(self.scenes), -1)
            strength = each[int(np.argmax(self.counts))]
        return trial.found(shapes, strength)

    def sums(self, columns: Sequence[Array]) -> Sums:
        """Their sums by block."""
        c = self._blocked(columns)
        turned = np.swapaxes(c, 1, 2)
        return Sums(turned @ c, turned @ self.base, (turned @ self.target)[..., 0])

    @cached_property
    def _folds(self) -> Folds:
        """The structure's sums over the stretches that each fold is fitted and judged on."""
        seen = self.seen
        held = np.array([seen & (self.fold == k) for k in range(self.settings.folds)], float)
        held = held[held.any(axis=1)]
        known = seen - held
        gram = np.einsum("fb,bij->fij", known, self.gram)
        inverse = np.linalg.pinv(gram, rcond=ROUNDING, hermitian=True)
        side = known @ self.base_side
        return Folds(
            *(known, held, inverse, side, np.einsum("fij,fj->fi", inverse, side)),
            *(np.einsum("fb,bij->fij", held, self.gram), held @ self.base_side, held @ self.square),
        )

    @cached_property
    def _own_seen(self) -> tuple[Array, Array]:
        return self._own(self.seen)

    def _own(self, known: Mask) -> tuple[Array, Array]:
        inverse = np.linalg.pinv(self.gram[known].sum(0), rcond=ROUNDING, hermitian=True)
        return inverse, inverse @ self.base_side[known].sum(0)

    def held_out(self, sums: Sums, trial: Trial) -> float:
        """Held-out squares of the stretches that the search sees, with a law; inf where its sign
        cannot be."""
        f = self._folds
        blocks, q = sums.side.shape
        joined = np.concatenate(
            [sums.own.reshape(blocks, -1), sums.cross.reshape(blocks, -1), sums.side], axis=1
        )
        known, held = (
            (s[:, : q * q].reshape(-1, q, q), s[:, q * q : -q].reshape(-1, q, self.base.shape[-1]),
             s[:, -q:])
            for s in (f.known @ joined, f.held @ joined)
        )  # fmt: skip
        absorbed = known[1] @ f.inverse
        left = known[0] - absorbed @ np.swapaxes(known[1], 1, 2)
        right = known[2] - np.einsum("fqi,fi->fq", absorbed, f.side)
        strength = _solved_alike(left, right, known[0])
        if trial.refuses(strength):
            return np.inf
        step = f.step - np.einsum("fqi,fq->fi", absorbed, strength)
        total = f.square - 2 * (step * f.held_side).sum(1)
        total += np.einsum("fij,fi,fj->f", f.gram, step, step)
        total -= 2 * (strength * held[2]).sum(1)
        total += np.einsum("fij,fi,fj->f", held[0], strength, strength)
        total += 2 * np.einsum("fqi,fq,fi->f", held[1], strength, step)
        return float(total.sum())

    @cached_property
    def own_held_out(self) -> float:
        """The same of the structure alone."""
        f = self._folds
        total = f.square - 2 * (f.step * f.held_side).sum(1)
        return float((total + np.einsum("fij,fi,fj->f", f.gram, f.step, f.step)).sum())

    def _solved(self, sums: Sums, known: Mask, inverse: Array) -> tuple[Array, Array]:
        """Strengths (q,) of a law and the structure's steps (Q,), fitted to some blocks."""
        own, cross, side = sums.of(known)
        absorbed = cross @ inverse
        left, right = own - absorbed @ cross.T, side - absorbed @ self.base_side[known].sum(0)
        strength = _solved_alike(left[None], right[None], own[None])[0]
        step = inverse @ (self.base_side[known].sum(0) - cross.T @ strength)
        return strength, step

    def _left(self, sums: Sums | None, which: Mask, step: Array, strength: Array) -> Array:
        """(blocks,) squares that are left of some blocks."""
        gram, side = self.gram[which], self.base_side[which]
        left = self.square[which] - 2 * side @ step + np.einsum("bij,i,j->b", gram, step, step)
        if sums is None:
            return left
        own, cross, its = sums.own[which], sums.cross[which], sums.side[which]
        left -= 2 * its @ strength
        left += np.einsum("bij,i,j->b", own, strength, strength)
        return left + 2 * np.einsum("bij,i,j->b", cross, strength, step)

    def scores(self, sums: Sums, which: Mask) -> Array:
        """(blocks, q) scores of a law among some blocks, the structure's taken out."""
        inverse, step = self._own_seen if which is self.seen else self._own(which)
        absorbed = sums.of(which)[1] @ inverse
        mine = sums.side[which] - sums.cross[which] @ step
        theirs = self.base_side[which] - self.gram[which] @ step
        return mine - theirs @ absorbed.T

    def strengths(self, sums: Sums, which: Mask) -> Array:
        """(q,) fitted to some blocks."""
        return self._solved(sums, which, self._own(which)[0])[0]

    def unseen_scores(self, sums: Sums) -> Array:
        """(blocks,) scores on unseen stretches of a law as the seen ones have it."""
        return self.scores(sums, self.unseen) @ self.strengths(sums, self.seen)

    def unseen_squares(self, sums: Sums) -> tuple[float, float]:
        """Squares of the unseen stretches that the structure and the law leave, both as the seen
        ones have them."""
        before = self._left(None, self.unseen, self._own_seen[1], np.zeros(0)).sum()
        return float(before), float(self.unseen_left(sums).sum())

    def unseen_left(self, sums: Sums) -> Array:
        """(blocks,) squares of the unseen stretches that a law leaves as the seen ones have it."""
        strength, step = self._solved(sums, self.seen, self._own_seen[0])
        return self._left(sums, self.unseen, step, strength)


RIDGE = 1e-9
"""Share of a column's squares."""

ROUNDING = 1e-10
"""Share of the largest eigenvalue under which a direction is not seen."""

MIN_LEFT = 1e-6
"""Share of a column's squares: where the structure absorbs all but this, nothing is left of it."""


class Trial:
    """A law as the search tries it: compiled once, evaluated at many shape constants."""

    def __init__(self, law: Law) -> None:
        self.law = law
        self.function: Callable[..., Any] = law.function()
        self.effect = FoundLaw(law, {}).effect(self.function)
        names = [name for c in law.constants for name in c.names]
        self._shape = {c.name: names.index(c.name) for c in law.shapes}
        self._columns = [
            (names.index(name), joint if c.each_wheel else None)
            for c in law.strengths
            for joint, name in enumerate(c.names)
        ]
        self.size = len(names)
        self.lower = np.array([c.lower for c in law.strengths for _ in c.names])
        self.upper = np.array([c.upper for c in law.strengths for _ in c.names])

    def units(self, shapes: Sequence[float]) -> list[tuple[list[float], int | None]]:
        """Values for each of its columns: one strength alone, at given shape constants."""
        found = []
        for place, joint in self._columns:
            values = [0.0] * self.size
            for at, value in zip(self._shape.values(), shapes, strict=True):
                values[at] = value
            values[place] = 1.0
            found.append((values, joint))
        return found

    def refuses(self, strength: Array) -> bool:
        """Whether strengths (..., q) have a sign that cannot be."""
        if self.is_uneven:
            return False
        least = np.maximum(self.lower, 0.0) if self.law.dissipative else self.lower
        # Of a law that each log has on its own the columns come once for each log.
        strength = strength.reshape(*strength.shape[:-1], -1, len(self.lower))
        return bool((strength < least).any() or (strength > self.upper).any())

    @property
    def is_uneven(self) -> bool:
        """Whether each wheel has its own strength: noise takes that of a free wheel below zero."""
        return len(self._columns) > len(self.law.strengths)

    def found(self, shapes: Sequence[float], strength: Array) -> FoundLaw:
        """The law with these values."""
        names = [name for c in self.law.strengths for name in c.names]
        values = dict(zip(names, strength.tolist(), strict=True))
        values |= dict(zip(self._shape, shapes, strict=True))
        return FoundLaw(self.law, values)


def by_name(trial: Trial, shapes: Sequence[float]) -> Mapping[str, float]:
    """Shape constants by name."""
    return {c.name: float(v) for c, v in zip(trial.law.shapes, shapes, strict=True)}
