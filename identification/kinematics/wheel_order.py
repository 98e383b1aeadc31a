"""Which wheels' columns are exchanged, in words."""

from __future__ import annotations

from youbot_env.physics.geometry import WHEELS


def described(order: tuple[int, ...]) -> str:
    """Which wheels' columns are exchanged, in words."""
    named: dict[tuple[int, ...], str] = {
        (2, 3, 0, 1): "front and back wheels",
        (1, 0, 3, 2): "left and right wheels",
        (3, 2, 1, 0): "wheels of opposite corners",
    }
    if order in named:
        return named[order]
    moved = [i for i, k in enumerate(order) if i != k]
    return "the columns of " + ", ".join(WHEELS[i] for i in moved) if moved else ""
