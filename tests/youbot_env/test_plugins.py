"""Effects from a user's own file: they work everywhere at once, and mistakes are one line."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from youbot_env import plugins
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model, save_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.plugins import load_effects, load_installed_effects
from youbot_env.simulation.free_run import initial_state, simulate

HEAD = "from youbot_env.physics.effect import BODY, WHEEL, Parameter, effect\n\n"

DRAG = (
    HEAD
    + '''
@effect(
    acts_at=WHEEL,
    parameters=[Parameter("coefficient", "N m s^2", lower=0.0, size=0.002)],
    source="a user", recognise="The residual grows with the square of a wheel's speed.",
    dissipative=True,
)
def my_drag(xp, wheel, coefficient):
    """Drag of each wheel [N m]: c phi' |phi'|."""
    return coefficient * wheel.rate * xp.abs(wheel.rate)
'''
)


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def written(folder: Path, source: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(source)
    return path


def test_an_effect_of_ones_own_simulates_and_is_saved(tmp_path: Path):
    (loaded,) = load_effects(written(tmp_path, DRAG))
    assert loaded.name == "my_drag" and "my_drag" in CATALOGUE
    base = load_model("paper")
    m = base.with_effect("my_drag", coefficient=0.01)
    time, torque = np.arange(50) * 0.02, np.ones((50, 4))
    dragged = simulate(m, time, torque, initial_state(m))
    free = simulate(base, time, torque, initial_state(base))
    assert 0 < dragged[-1, 0] < free[-1, 0]
    save_model(tmp_path / "m.json", m)
    assert load_model(tmp_path / "m.json").values["my_drag.coefficient"] == 0.01


WHERE_AND_TOGETHER = (
    HEAD
    + '''
@effect(
    acts_at=WHEEL,
    parameters=[Parameter("torque", "N m", lower=0.0, size=0.2),
                Parameter("share", "1/(N m)", lower=0.0, upper=0.1, size=0.02)],
    source="a user", recognise="Wheels turn harder beyond a line, and are weak together.",
)
def rough_and_weak(xp, wheel, torque, share):
    """Dry friction of each wheel beyond x = 0.1 m, and what all lose together [N m]."""
    beyond = 0.5 + 0.5 * xp.tanh((wheel.contact.x - 0.1) / 0.02)
    lost = share * wheel.torque * wheel.total_torque
    return torque * beyond * xp.tanh(wheel.rate / 0.1) + lost
'''
)


def test_an_effect_sees_where_each_wheel_stands_and_what_all_wheels_do(tmp_path: Path):
    load_effects(written(tmp_path, WHERE_AND_TOGETHER))
    model = load_model("paper").with_effect("rough_and_weak", torque=0.3, share=0.03)
    base, geometry = load_model("paper"), model.geometry
    twist, acceleration, pose = [0.2, -0.1, 0.3], [0.1, 0.2, -0.3], [0.05, -0.2, 0.6]
    # By hand: the front wheels at (h, +-l), turned by the heading, are beyond the line.
    ahead = pose[0] + np.cos(0.6) * geometry.h * np.array([1, 1, -1, -1])
    x = ahead - np.sin(0.6) * geometry.l * np.array([1, -1, 1, -1])
    rates = model.joint_jacobian @ twist
    friction = 0.3 * (0.5 + 0.5 * np.tanh((x - 0.1) / 0.02)) * np.tanh(rates / 0.1)
    assert 0 < friction.max() and np.abs(friction).min() < 1e-3
    torque = model.inverse_dynamics(twist, acceleration, pose=pose)
    lost = 0.03 * torque * np.abs(torque).sum()
    found = model.joint_jacobian.T @ (torque - friction - lost)
    assert found == pytest.approx(base.wrench(twist, acceleration), abs=1e-12)
    # What simulates is generated from the same function.
    state = initial_state(model, twist=twist, pose=pose)
    change = model.state_derivative(state, torque)
    assert change[:3] == pytest.approx(acceleration, abs=1e-9)


def test_a_loss_and_a_torque_of_its_own_drive_a_platform_at_rest(tmp_path: Path):
    """Without the effect no torque acts at rest: nothing to compare a torque with."""
    source = WHERE_AND_TOGETHER.replace(
        "torque * beyond * xp.tanh(wheel.rate / 0.1) + lost", "torque + share * wheel.torque"
    )
    load_effects(written(tmp_path, source))
    model = load_model("paper").with_effect("rough_and_weak", torque=0.3, share=0.1)
    still = model.inverse_dynamics([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert still == pytest.approx([0.3 / 0.9] * 4)


def test_a_root_below_zero_at_some_motions_is_one_line(tmp_path: Path):
    load_effects(written(tmp_path, DRAG.replace("wheel.rate *", "xp.sqrt(wheel.contact.x) *")))
    with pytest.raises(InputError, match=r"my_drag: fails at some motions .* xp.maximum"):
        _ = mecanum_structure(["my_drag"]).depends_on_load


def test_a_model_file_alone_never_loads_an_effects_file(tmp_path: Path):
    written(tmp_path, DRAG)
    m = load_model("paper")
    with CATALOGUE.restored_on_error():
        load_effects(tmp_path / "mine.py")
        save_model(tmp_path / "m.json", m.with_effect("my_drag", coefficient=0.01))
    CATALOGUE._effects.pop("my_drag")
    with pytest.raises(InputError, match="m.json: unknown effect 'my_drag'"):
        load_model(tmp_path / "m.json")


def test_loading_twice_is_harmless(tmp_path: Path):
    path = written(tmp_path, DRAG)
    first, second = load_effects(path), load_effects(path)
    assert [e.name for e in first] == [e.name for e in second] == ["my_drag"]


MISTAKES = {
    "syntax": ("x = (\n", "row 1: SyntaxError"),
    "name": ("x = 1\ny = nothing\n", "row 2: NameError"),
    "import": ("import no_such_package\n", "row 1: ModuleNotFoundError"),
    "exit": ("import sys\nsys.exit(3)\n", "row 2: SystemExit"),
    "nothing registered": ("x = 1\n", "registers no effect"),
    "taken": (DRAG.replace("my_drag", "floor_tilt"), "already registered"),
    "arguments": (DRAG.replace("wheel, coefficient)", "wheel, c)"), "but declares"),
    "math": (DRAG.replace("xp.abs", "__import__('math').fabs"), "use the functions of xp"),
    "branch": (
        DRAG.replace("return", "if wheel.rate > 0:\n        return 0 * coefficient\n    return"),
        "fails on symbols",
    ),
    "nothing returned": (DRAG.replace("return coefficient", "coefficient"), "returns None"),
    "three at a wheel": (DRAG.replace("return coefficient", "return 0, 0, coefficient"), "one num"),
    "one at the body": (
        DRAG.replace("WHEEL,", "BODY,").replace("wheel.rate", "wheel.twist[0]"),
        "three numbers",
    ),
    "unknown field": (DRAG.replace("wheel.rate", "wheel.speed"), "no attribute 'speed'"),
    "size out of bounds": (DRAG.replace("size=0.002", "size=-1.0"), "outside its own bounds"),
    "good then bad": (DRAG + "raise ValueError('on\\nsecond thoughts')\n", "ValueError: on second"),
}


@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_is_one_line_and_leaves_the_catalogue(tmp_path: Path, kind: str):
    source, expected = MISTAKES[kind]
    path = written(tmp_path, source)
    before = CATALOGUE.names()
    with pytest.raises(InputError) as caught:
        load_effects(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and expected in message and "\n" not in message
    assert CATALOGUE.names() == before


def test_what_is_no_python_file_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no such file"):
        load_effects(tmp_path / "missing.py")
    with pytest.raises(InputError, match=r"must end in \.py"):
        load_effects(written(tmp_path, DRAG, "mine.txt"))
    with pytest.raises(InputError, match="SyntaxError"):
        path = tmp_path / "binary.py"
        path.write_bytes(bytes(range(256)))
        load_effects(path)


class Entry:
    """An installed package's entry point."""

    name, dist = "drag", None

    def __init__(self, source: str) -> None:
        self.source = source

    def load(self) -> None:
        exec(self.source, {"__name__": "installed"})


def test_installed_packages_offer_effects(monkeypatch: pytest.MonkeyPatch):
    def points(group: str) -> list[Entry]:
        return [Entry(DRAG)] if group == plugins.GROUP else []

    monkeypatch.setattr(metadata, "entry_points", points)
    assert [e.name for e in load_installed_effects()] == ["my_drag"]
    assert "my_drag" in CATALOGUE


def test_a_broken_package_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(metadata, "entry_points", lambda group: [Entry("1 / 0")])
    with pytest.raises(
        InputError, match="an installed package: youbot.effects: drag: ZeroDivision"
    ):
        load_installed_effects()


def test_without_such_packages_nothing_happens():
    before = CATALOGUE.names()
    assert load_installed_effects() == () and CATALOGUE.names() == before
