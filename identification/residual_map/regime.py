"""Where what remains lives: a rule over logged columns, such as "pose_x > 1.2" or "after 48 s".

A residual of least squares lies everywhere: what acts in a part of the motion bends the fit in the
rest of it too. So each rule is judged by a fit to the rows outside of it. If that leaves there no
more than noise, and much more inside, what is missing lives inside. The rule is the one with the
largest likelihood of two normal distributions, one for each side; it must hold on stretches of time
that it was not chosen on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from identification.fitting.regression import Regression, filtered_rows
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.residual_map.settings import RegimeSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Range = tuple[float, float]
"""From and to, of which one may be infinite."""

WORLD = "pose"
PLACE = (f"{WORLD}_x", f"{WORLD}_y")
"""Columns of a place on the floor, which are cut together."""


TIMES = ("before", "after", "between")
"""How rules begin that are of the time from a log's start."""


@dataclass(frozen=True)
class Regime:
    """Where what remains lives.

    rule : in words; share : of the squares beyond noise that lie inside; rows : of all rows
    """

    rule: str
    share: float
    rows: float

    @property
    def variables(self) -> tuple[str, ...]:
        """What the rule cuts, in the words of a residual map."""
        if self.rule.startswith(TIMES):
            return ("time",)
        columns = {"pose_yaw": "heading", "pose_": "position_", "velocity_": "wheel_speed_"}
        found = []
        for word in re.findall(r"[a-z]+_[a-z]+", self.rule):
            for column, variable in columns.items():
                if word.startswith(column):
                    found.append(word.replace(column, variable))
                    break
        return tuple(found)

    @property
    def sentence(self) -> str:
        """The rule in a sentence."""
        where = f"where {self.rule}" if "<" in self.rule or ">" in self.rule else f"in {self.rule}"
        if self.rule.startswith(TIMES):
            where = f"{self.rule} of each log"
        return f"what remains lives {where}: {self.share:.0%} of it, in {self.rows:.0%} of the time"


@dataclass(frozen=True)
class Column:
    """Something that rows may be cut by: its values (N,), edges between bins, and words for it."""

    name: str
    values: Array
    edges: Array
    unit: str = ""

    @property
    def bins(self) -> NDArray[np.intp]:
        """(N,) bin of each row: 0 below the first edge."""
        return np.searchsorted(self.edges, self.values, side="right")

    def finer(self, bounds: Range, settings: RegimeSettings) -> Column:
        """The same column, cut finely near the bounds of a range, and nowhere else."""
        edges: list[float] = []
        ends = np.concatenate([[self.values.min()], self.edges, [self.values.max()]])
        for bound in filter(np.isfinite, bounds):
            place = int(np.argmin(np.abs(ends - bound)))
            low, high = ends[max(place - 1, 0)], ends[min(place + 1, len(ends) - 1)]
            edges += np.linspace(low, high, settings.fine_bins + 1)[1:-1].tolist()
        return replace(self, edges=np.unique(edges))

    def words(self, inside: Range) -> str:
        """A range as a condition; "" if it is everything."""
        low, high = inside
        if self.name == "time":
            before, after = f"before {high:.0f} s", f"after {low:.0f} s"
            both = f"between {low:.0f} and {high:.0f} s"
        else:
            before, after = f"{self.name} < {high:.2g}", f"{self.name} > {low:.2g}"
            both = f"{low:.2g} < {self.name} < {high:.2g}"
        if np.isfinite(low):
            return both if np.isfinite(high) else after
        return before if np.isfinite(high) else ""


@dataclass(frozen=True)
class _Ranged:
    """The likeliest range of a column: its bounds, the rows inside (n,), and how it splits."""

    column: Column
    bounds: Range
    mask: Mask
    split: Split


class RowSums:
    """Normal equations of rows by bin, so that those of any range are a difference of two sums.

    columns (n, A, P), residual (n, A); bins (n,), of some number ``count``.
    """

    def __init__(self, columns: Array, residual: Array, bins: NDArray[np.intp], count: int) -> None:
        joined = np.concatenate([columns, residual[..., None]], axis=-1)
        size = joined.shape[-1]
        found = np.zeros((count, size, size))
        order = np.argsort(bins, kind="stable")
        sizes = np.bincount(bins, minlength=len(found))
        start = 0
        for k, many in enumerate(sizes.tolist()):
            part = joined[order[start : start + many]].reshape(-1, size)
            found[k], start = part.T @ part, start + many
        self.gram, self.rows = found, sizes.astype(float)

    @property
    def total(self) -> tuple[Array, float]:
        """Of all rows."""
        return self.gram.sum(axis=0), float(self.rows.sum())

    def inside(self, ends: tuple[int, int]) -> tuple[Array, float]:
        """Of the bins from one up to (without) another one."""
        chosen = slice(*ends)
        return self.gram[chosen].sum(axis=0), float(self.rows[chosen].sum())


def _solved(gram: Array, least: Array) -> Array:
    """Least-squares parameters (P,) of a joined Gram matrix of columns and residual.

    ``least`` (P,): information of each parameter with less of which it stays at zero, where the fit
    to all rows has it: rows that hardly show it say nothing of it.
    """
    inner, side = gram[:-1, :-1], gram[:-1, -1]
    return np.asarray(np.linalg.solve(inner + np.diag(least), side), np.float64)


def _square(gram: Array, theta: Array) -> float:
    """Squares that these parameters leave of the residual."""
    weights = np.append(-theta, 1.0)
    return max(float(weights @ gram @ weights), 1e-300)


@dataclass(frozen=True)
class Split:
    """How a rule splits rows: mean squares of what a fit to the outside leaves, and the gain.

    inside, outside : mean squares a row; share : of the rows inside; gain : of log-likelihood a row
    """

    inside: float
    outside: float
    share: float
    gain: float


def split_of(
    total: tuple[Array, float], part: tuple[Array, float], least_information: float
) -> Split | None:
    """The split of all rows by those of a part; None if a side holds too few."""
    (all_rows, count), (inner, n_in) = total, part
    n_out = count - n_in
    if min(n_in, n_out) < 2 * len(all_rows):
        return None
    outer, least = all_rows - inner, _least(all_rows, least_information)
    theta = _solved(outer, least)
    inside, outside = _square(inner, theta) / n_in, _square(outer, theta) / n_out
    whole = _square(all_rows, _solved(all_rows, least)) / count
    share = n_in / count
    gain = 0.5 * (np.log(whole) - share * np.log(inside) - (1 - share) * np.log(outside))
    return Split(inside, outside, share, float(gain))


def _least(gram: Array, share: float) -> Array:
    """(P,) a share of the information that all rows hold on each parameter."""
    return np.asarray(share * np.diag(gram)[:-1] + 1e-300, float)


@dataclass(frozen=True)
class Rule:
    """Ranges of columns, all of which hold inside; or a log."""

    words: str
    mask: Mask
    split: Split


def find_regime(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    noise: float,
    settings: RegimeSettings = RegimeSettings(),
    fit: FitSettings = FitSettings(),
) -> Regime | None:
    """The rule that says where a structure's residual lives, if there is one.

    Parameters
    ----------
    rows : per log, with the columns of the structure's free parameters, made with ``fit``
    noise : mean square of a row, over all axes, that is no more than noise
    """
    search = _Search(rows, settings)
    known = _columns(mechanism, rows, samples, settings, fit)
    rules = [*search.of_logs([item.name for item in samples]), *search.of_columns(known)]
    rules = [rule for rule in rules if rule.words]
    rules.sort(key=lambda rule: -rule.split.gain)
    stretches = _stretches(rows, settings)
    # Of the likeliest rules the first that holds on stretches that were left out.
    for rule in rules[: settings.judged_rules]:
        if found := search.judged(rule, stretches, noise):
            return found
    return None


def _stretches(rows: Sequence[Regression], settings: RegimeSettings) -> NDArray[np.intp]:
    """(n,) 0 or 1 in turn, by stretches of time of each log."""
    parts = [(row.time // settings.stretch_duration).astype(np.intp) % 2 for row in rows]
    return np.concatenate(parts)


class _Search:
    """Rules for the rows of some logs: residual (n, A) and columns (n, A, P) of all of them."""

    def __init__(self, rows: Sequence[Regression], settings: RegimeSettings) -> None:
        self.residual = np.concatenate([row.residual for row in rows])
        self.columns = np.concatenate([row.columns for row in rows])
        self.log = np.repeat(np.arange(len(rows)), [len(row.residual) for row in rows])
        self.memory = round(settings.filter_memory / rows[0].step)
        # Rows in which the mechanism rests are zero: no rule is to say that it moves.
        self.settings, self.everything = settings, (self.residual != 0).any(axis=1)
        self.total = self._sums(np.zeros(len(self.residual), np.intp), 1).total

    def _sums(self, bins: NDArray[np.intp], count: int, among: Mask | None = None) -> RowSums:
        chosen = self.everything if among is None else among
        return RowSums(self.columns[chosen], self.residual[chosen], bins[chosen], count)

    def _split(self, part: tuple[Array, float]) -> Split | None:
        return split_of(self.total, part, self.settings.min_outside_information)

    def of_logs(self, names: Sequence[str]) -> Iterator[Rule]:
        """Each log alone, and of few logs each two."""
        sums, count = self._sums(self.log, len(names)), len(names)
        sizes = (1, 2) if 2 < count <= self.settings.max_logs_for_pairs else (1,)
        for chosen in (c for size in sizes for c in combinations(range(count), size)):
            logs = list(chosen)
            split = self._split((sums.gram[logs].sum(axis=0), float(sums.rows[logs].sum())))
            if split and count > 1 and split.inside > split.outside:
                mask = np.isin(self.log, logs)
                yield Rule(" or ".join(names[k] for k in logs), mask, split)

    def of_columns(self, known: Sequence[Column]) -> Iterator[Rule]:
        """The likeliest range of each column, and the likeliest rectangle of the place."""
        found: dict[str, _Ranged] = {}
        for column in known:
            if ranged := self._likeliest(column, self.everything):
                found[column.name] = ranged
                yield self._rule([ranged])
        place = [column for column in known if column.name in PLACE]
        pairs = [place, place[::-1]] if len(place) == 2 else []
        for first, second in pairs:
            if first.name not in found:
                continue
            one, other = found[first.name], None
            # Each range in turn, inside of the other one.
            for _ in range(self.settings.rectangle_rounds):
                other = self._likeliest(second, one.mask)
                one = (other and self._likeliest(first, other.mask)) or one
            if other:
                yield self._rule([one, other])

    def _rule(self, ranges: Sequence[_Ranged]) -> Rule:
        words = [ranged.column.words(self._plain(ranged)) for ranged in ranges]
        mask = np.logical_and.reduce([ranged.mask for ranged in ranges])
        # The last one was found inside of the others.
        best = max((ranged.split for ranged in ranges), key=lambda split: split.gain)
        return Rule(" and ".join(word for word in words if word), mask, best)

    def _plain(self, ranged: _Ranged) -> Range:
        """A range whose bounds are zero where they are near it, as people say it."""
        column, near = ranged.column, 0.0
        if column.name.startswith("velocity"):
            near = self.settings.max_distance_from_zero * float(column.values.std())
        low, high = (0.0 if abs(bound) < near else bound for bound in ranged.bounds)
        # A range that lies about zero is narrow: it has two bounds of its own.
        return ranged.bounds if low == high else (low, high)

    def _likeliest(self, column: Column, among: Mask) -> _Ranged | None:
        """The likeliest range of a column among some rows, its ends sought more finely."""
        coarse = self._range_of(column, among)
        if coarse is None:
            return None
        return self._range_of(column.finer(coarse.bounds, self.settings), among) or coarse

    def _range_of(self, column: Column, among: Mask) -> _Ranged | None:
        count = len(column.edges) + 1
        sums, best = self._sums(column.bins, count, among), None
        for ends in _ranges(count):
            split = self._split(sums.inside(ends))
            if split and split.inside > split.outside and (best is None or split.gain > best[0]):
                best = split.gain, split, ends
        if best is None:
            return None
        low, high = bounds = _bounds(column, best[2])
        mask = among & (column.values >= low) & (column.values < high)
        return _Ranged(column, bounds, mask, best[1])

    def judged(self, rule: Rule, stretches: NDArray[np.intp], noise: float) -> Regime | None:
        """The regime of a rule, if half of the stretches say it of the other half."""
        settings, mask = self.settings, rule.mask & self.everything
        # The filter remembers what was inside; such rows are on neither side.
        outside = self.everything & ~mask & ~self._soon_after(mask)
        inner = outer = n_in = n_out = 0.0
        least = _least(self.total[0], settings.min_outside_information)
        for half in (0, 1):
            known, held = stretches != half, stretches == half
            sums = self._sums(np.zeros(len(mask), np.intp), 1, known & outside)
            left = ((self.residual - self.columns @ _solved(sums.gram[0], least)) ** 2).sum(axis=1)
            inner += float(left[held & mask].sum())
            outer += float(left[held & outside].sum())
            n_in += float((held & mask).sum())
            n_out += float((held & outside).sum())
        if min(n_in, n_out) == 0 or inner / n_in < settings.min_square_ratio * outer / n_out:
            return None
        if outer / n_out > settings.max_outside_over_noise * noise:
            return None
        beyond_in = inner - noise * n_in
        beyond_out = max(outer - noise * n_out, 0.0)
        share = beyond_in / max(beyond_in + beyond_out, 1e-300)
        if beyond_in <= 0 or share < settings.min_share_inside:
            return None
        return Regime(rule.words, float(share), float(mask[self.everything].mean()))

    def _soon_after(self, mask: Mask) -> Mask:
        """(n,) rows that the filter's memory reaches from those before them."""
        found = np.zeros_like(mask)
        for shift in range(1, self.memory + 1):
            found[shift:] |= mask[:-shift] & (self.log[shift:] == self.log[:-shift])
        return found


def _ranges(size: int) -> list[tuple[int, int]]:
    """All ranges of bins, all of them too."""
    return [(a, b) for a in range(size) for b in range(a + 1, size + 1)]


def _bounds(column: Column, ends: tuple[int, int]) -> Range:
    edges = np.concatenate([[-np.inf], column.edges, [np.inf]])
    return float(edges[ends[0]]), float(edges[ends[1]])


def _columns(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    settings: RegimeSettings,
    fit: FitSettings,
) -> list[Column]:
    """What rows may be cut by, as a log's columns are called."""
    found: dict[str, list[Array]] = {}
    for row, item in zip(rows, samples, strict=True):
        known = mechanism.variables(item)
        speed = known.speed if known.speed is not None else known.twist
        values = {
            _named("velocity", joint): v for joint, v in zip(known.joints, speed.T, strict=True)
        }
        values |= {f"abs({name})": np.abs(v) for name, v in values.items()}
        world = WORLD if known.heading is not None else "position"
        values |= {_named(world, p): v for p, v in zip(known.places, known.position.T, strict=True)}
        if known.heading is not None:
            values[f"{world}_yaw"] = np.mod(known.heading + np.pi, 2 * np.pi) - np.pi
        for name, signal in values.items():
            ends = np.stack([signal[:-1], signal[1:]])
            reduced = filtered_rows(ends[..., None], mechanism, item, fit)[:, 0]
            found.setdefault(name, []).append(reduced[: len(row.time)])
        found.setdefault("time", []).append(row.time)
    return [_cut(name, np.concatenate(parts), settings) for name, parts in found.items()]


def _named(kind: str, which: str) -> str:
    return f"{kind}_{which}" if which else kind


def _cut(name: str, values: Array, settings: RegimeSettings) -> Column:
    """A column cut where equal shares of its rows lie between."""
    shares = np.linspace(0.0, 1.0, settings.bins + 1)[1:-1]
    return Column(name, values, np.unique(np.quantile(values, shares)))
