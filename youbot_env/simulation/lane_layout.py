"""How the rows of a block lie in memory.

A block holds ``LANES`` rows. ``x`` is one block, field by field: number ``f`` of row ``i`` stands
at ``x[f * LANES + i]``. Distances between fields are then known to the compiler.
"""

from __future__ import annotations

LANES = 144
"""Rows in a block: a block of some 100 numbers a row stays in the second-level cache, and what each
loop costs before its first row is little beside its rows (64 rows: 3 to 15 % slower; 256: slower
again, as a block then leaves the first-level cache between loops). No power of two: fields would
lie a power of two apart and share a few places of the first-level cache (128 rows: one effect 8 %
slower, six 12 %). A multiple of 16, so that loops end with whole vectors."""

TOGETHER = 48
"""Rows that are integrated to the end of a period before others begin: what they work with stays in
the first-level cache. A part of ``LANES``."""

TORQUE, DURATION, LATE, COEFFICIENTS = 0, 4, 5, 6
"""Fields of the workspace ``w``: torques at the interface, length of a step [s], delay of torques
[s], coefficients."""
