"""Joints by name, where a text file has the names in columns of their own or not at all.

``rostopic echo -p`` writes ``field.name0`` beside ``field.velocity0``; ``ros2 topic echo --csv``
writes the names among the numbers, and no header.
"""

from __future__ import annotations

import re

import numpy as np

from identification.importing.clocks import TIME_UNITS
from identification.importing.settings import ImportSettings
from identification.importing.tables import Array, Table
from identification.importing.vocabulary import EFFORT, POSITION, VELOCITY, meaning, words_of

_NAMES = frozenset(["name", "names", "joint_name", "joint_names"])
_UNNAMED = re.compile(r"column_(\d+)")


def name_joints(table: Table, settings: ImportSettings = ImportSettings()) -> None:
    """Names the columns of a table by its joints, where it holds their names."""
    joints = {
        (words_of(name)[:-2], meaning(name).number): text
        for name, text in table.texts.items()
        if meaning(name).number is not None and _NAMES & set(words_of(name))
    }
    renamed: dict[str, str] = {}
    for name in table.columns:
        found = meaning(name)
        joint = joints.get((words_of(name)[:-2], found.number))
        if joint and found.quantity in (VELOCITY, EFFORT, POSITION):
            renamed[name] = f"{re.sub(r'[^A-Za-z]*[0-9]+[^A-Za-z0-9]*$', '', name)}[{joint}]"
    _rename(table, renamed)
    if not renamed and all(_UNNAMED.fullmatch(name) for name in table.columns):
        _name_echoed(table, settings)
        _name_by_place(table)


def _rename(table: Table, renamed: dict[str, str]) -> None:
    table.columns = {renamed.get(name, name): values for name, values in table.columns.items()}
    table.units = {renamed.get(name, name): unit for name, unit in table.units.items()}


def _name_echoed(table: Table, settings: ImportSettings) -> None:
    """Names the columns of an echoed JointState: stamp, frame, names, then a list a quantity."""
    unnamed = ((_UNNAMED.fullmatch(name), text) for name, text in table.texts.items())
    texts = {int(match[1]): text for match, text in unnamed if match}
    numbers = {int(name.split("_")[1]): name for name in table.columns}
    joints = [texts[k] for k in sorted(texts) if meaning(texts[k]).wheel]
    if len(joints) < 4:
        return
    last = max(k for k in texts if texts[k] in joints)
    # Names of other joints (an arm's) stand in the same list.
    listed = [texts[k] for k in sorted(texts) if k > last - len(texts) and texts[k] in joints]
    behind = [numbers[k] for k in sorted(numbers) if k > last]
    before = [numbers[k] for k in sorted(numbers) if k < last]
    count, left = divmod(len(behind), len(listed))
    if not 1 <= count <= 3 or left:
        return
    blocks = [behind[k * len(listed) : (k + 1) * len(listed)] for k in range(count)]
    stamp = _stamp(table, before)
    if stamp is not None:
        table.clocks["header.stamp"] = stamp
    if count == 3:
        quantities = [POSITION, VELOCITY, EFFORT]
    elif count == 2:
        first, second = (np.column_stack([table.columns[n] for n in b]) for b in blocks)
        integrates = stamp is not None and _is_derivative(first, second, stamp)
        quantities = [POSITION, VELOCITY] if integrates else [VELOCITY, EFFORT]
    else:
        quantities = [VELOCITY]
    table.note(f"read as an echoed JointState of {', '.join(listed)}: {', '.join(quantities)}")
    named = {
        column: f"{quantity}[{joint}]"
        for quantity, block in zip(quantities, blocks, strict=True)
        for joint, column in zip(listed, block, strict=True)
    }
    _rename(table, named)


def _name_by_place(table: Table) -> None:
    """Names the columns of a table without header by their place: time, speeds, efforts."""
    names = list(table.columns)
    if len(names) < 5 or not all(_UNNAMED.fullmatch(name) for name in names):
        return
    first = table.columns[names[0]]
    rising = np.diff(first[np.isfinite(first)]) > 0
    if not rising.size or not rising.mean() > ImportSettings.min_number_share:
        return
    parts = (VELOCITY, EFFORT, POSITION)
    named = {names[0]: "time"}
    for part, start in zip(parts, range(1, len(names) - 3, 4), strict=False):
        named |= {names[start + k]: f"{part}[{k}]" for k in range(4)}
    _rename(table, named)
    told = ", ".join(parts[: (len(named) - 1) // 4])
    table.questions.append(f"there is no header: are its columns time and, of four wheels, {told}?")


def _stamp(table: Table, before: list[str]) -> Array | None:
    """Seconds and nanoseconds before a list of names."""
    if len(before) < 2:
        return None
    seconds, nanoseconds = (table.columns[name] for name in before[:2])
    return seconds + nanoseconds * TIME_UNITS["ns"]


def _is_derivative(first: Array, second: Array, time: Array) -> bool:
    """Whether the second columns (n, k) are the rates of the first ones at times (n,)."""
    with np.errstate(all="ignore"):
        rate = np.diff(first, axis=0) / np.diff(time)[:, None]
    mean = (second[1:] + second[:-1]) / 2
    good = np.isfinite(rate).all(axis=1) & np.isfinite(mean).all(axis=1)
    if good.sum() < 3:
        return False
    correlation = np.corrcoef(rate[good].ravel(), mean[good].ravel())[0, 1]
    return bool(correlation > ImportSettings.min_delay_correlation)
