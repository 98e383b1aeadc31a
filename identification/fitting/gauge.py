"""Parameters of which only differences can be seen (gains, extra frictions of the four wheels)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def gauge_groups(mechanism: Mechanism, free: Indices | None = None) -> list[Indices]:
    """Places among the parameters ``free`` of those that are relative to each other, by group."""
    labels = [mechanism.labels[k] for k in _chosen(mechanism, free)]
    groups = dict.fromkeys(label.group for label in labels if label.group)
    return [
        np.array([k for k, label in enumerate(labels) if label.group == group], dtype=np.intp)
        for group in groups
    ]


def _chosen(mechanism: Mechanism, free: Indices | None) -> Indices:
    return np.flatnonzero(mechanism.free) if free is None else free


def gauge_directions(
    mechanism: Mechanism, free: Indices | None = None
) -> list[tuple[Indices, Array]]:
    """Places of each group among the parameters ``free``, and the unit vector (members,) of what
    no data can see: their common part, or of torques the part that exerts no force."""
    labels = [mechanism.labels[k] for k in _chosen(mechanism, free)]
    found: list[tuple[Indices, Array]] = []
    for members in gauge_groups(mechanism, free):
        internal = labels[int(members[0])].parameter.relative_to == "internal"
        unseen = np.array(mechanism.internal if internal else [1.0] * len(members))
        found.append((members, unseen / np.linalg.norm(unseen)))
    return found


def gauge_basis(mechanism: Mechanism, free: Indices | None = None) -> Array:
    """(F, Q) directions of the parameters ``free`` that data can see at all.

    Of values that are relative to each other (gains, extra frictions) only differences can be
    seen: their sum is held at zero. Of offsets of the torques, what exerts a force. What other
    evidence has settled is left out, too.
    """
    size = len(_chosen(mechanism, free))
    groups = gauge_directions(mechanism, free)
    # The empty list is for mechanisms without groups: concatenate needs at least one array.
    alone = np.setdiff1d(np.arange(size), np.concatenate([[], *(members for members, _ in groups)]))
    columns = [np.eye(size)[:, alone]]
    for members, unseen in groups:
        block = np.zeros((size, len(members) - 1))
        # Orthonormal complement of it, from the QR factors of a full-rank matrix.
        frame = np.column_stack([unseen, np.eye(len(members))[:, 1:]])
        block[members] = np.linalg.qr(frame)[0][:, 1:]
        columns.append(block)
    return _without_held(np.hstack(columns), mechanism, free)


def _without_held(basis: Array, mechanism: Mechanism, free: Indices | None) -> Array:
    """The directions of a basis (F, Q) that are not held by other evidence."""
    labels = [mechanism.labels[k] for k in _chosen(mechanism, free)]
    for held in mechanism.held:
        own = [k for k, label in enumerate(labels) if label.component == held.effect]
        if not (own and held.directions):
            continue
        component = np.array(held.directions) @ basis[own]
        _, sizes, rows = np.linalg.svd(component)
        rank = int((sizes > 1e-6).sum())
        basis = basis @ rows[rank:].T
    return basis
