"""A user's controller from a file: how it is found, built and what its mistakes are called."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from controllers import registry
from controllers.interface import Loop, Observation, Reference
from controllers.user_file import left_out
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

MODEL, LOOP = load_model("paper"), Loop()
SEEN = Observation(0.0, np.zeros(4), np.zeros(3))
WANTED = Reference(np.array([0.3, 0.0, 0.0]), np.zeros(3))

PUSH = """
class Push:
    preview_needed = 2
    def __init__(self{arguments}):
        {body}
    def reset(self):
        self.count = 0
    def __call__(self, observation, reference):
        return [0.5 * reference.twist[0]] * 4
"""


def file(tmp_path: Path, text: str) -> str:
    path = tmp_path / "my_controller.py"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    "text",
    [
        PUSH.format(arguments="", body="pass"),
        PUSH.format(arguments=", model", body="assert model.geometry.R > 0"),
        PUSH.format(arguments=", model, loop", body="assert loop.torque_limit > 0"),
        PUSH.format(arguments=", gain=1.0", body="pass"),
        PUSH.format(arguments=", gain", body="pass")
        + "def controller(model, loop):\n    return Push(gain=2)\n",
    ],
    ids=["nothing", "model", "both", "default", "factory"],
)
def test_a_file_is_a_name_of_the_registry(text: str, tmp_path: Path) -> None:
    name = file(tmp_path, text)
    registry.check(name)
    built = registry.build(name, MODEL, LOOP)
    built.reset()
    assert built(SEEN, WANTED) == pytest.approx([0.15] * 4)
    assert getattr(built, "preview_needed", 0) == 2


def test_of_several_classes_one_is_named(tmp_path: Path) -> None:
    text = PUSH.format(arguments="", body="pass")
    name = file(tmp_path, text + text.replace("Push", "Pull").replace("0.5", "-0.5"))
    with pytest.raises(InputError, match=rf"holds Push, Pull; name one: {name}:Push"):
        registry.check(name)
    registry.check(f"{name}:Pull")
    assert registry.build(f"{name}:Pull", MODEL, LOOP)(SEEN, WANTED)[0] < 0
    with pytest.raises(InputError, match="holds no 'Nothing'; controllers in it: Push, Pull"):
        registry.check(f"{name}:Nothing")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "holds no controller: a class with reset"),
        ("x = = 1\n", "row 1: SyntaxError"),
        ("import no_such_library\n", "row 1: ModuleNotFoundError"),
        ("def controller(model, loop):\n    return 3\n", "makes a int, which is no controller"),
        (PUSH.format(arguments=", model", body="model.nothing"), "row 5: AttributeError"),
        ("raise SystemExit(3)\n", "row 1: SystemExit"),
    ],
)
def test_mistakes_of_a_file_are_one_line_with_its_row(
    text: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        registry.check(file(tmp_path, text))
    assert "\n" not in str(caught.value) and "my_controller.py" in str(caught.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("return [1.0, 2.0]", r"returned shape \(2,\); it must return four torques"),
        ("return None", "returned a NoneType|returned shape"),
        ("return 1 / 0", "row 9: ZeroDivisionError"),
        ("return observation.speed", "row 9: AttributeError"),
    ],
)
def test_mistakes_of_a_call_too(line: str, message: str, tmp_path: Path) -> None:
    text = PUSH.format(arguments="", body="pass")
    text = text.replace("return [0.5 * reference.twist[0]] * 4", line)
    built = registry.build(file(tmp_path, text), MODEL, LOOP)
    with pytest.raises(InputError, match=message):
        built(SEEN, WANTED)


def test_a_changed_file_is_another_controller(tmp_path: Path) -> None:
    name = file(tmp_path, PUSH.format(arguments="", body="pass"))
    before = registry.fingerprint(name)
    assert before == registry.fingerprint(name)
    file(tmp_path, PUSH.format(arguments="", body="pass  # better"))
    assert registry.fingerprint(name) != before


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.py: no such file"):
        registry.check(str(tmp_path / "no.py"))


def of_the_page() -> str:
    """The example of docs/controllers.md."""
    page = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")
    return page.split("```py\n")[1].split("```")[0]


LEVEL = of_the_page().replace("pose=pose, wheel_angle=self.angle, ", "")


def test_the_documented_controller_tells_its_model_where_it_is(tmp_path: Path) -> None:
    tilted = MODEL.with_effect("floor_tilt", tilt_x=0.02)
    name = file(tmp_path, of_the_page())
    for show_pose in (False, True):
        assert left_out(name, tilted, LOOP, show_pose=show_pose) is None
    (tmp_path / "my_controller.py").write_text(LEVEL)
    words = left_out(name, tilted, LOOP, show_pose=True)
    assert words is not None and "without pose=..., which floor_tilt" in words
    assert left_out(name, MODEL, LOOP, show_pose=False) is None, "nothing in it reads a place"


def test_what_is_left_out_costs_what_it_feeds_forward(tmp_path: Path) -> None:
    """On a slope, turning: the torques of the example hold the robot at every heading."""
    tilted = MODEL.with_effect("floor_tilt", tilt_x=0.02)
    (tmp_path / "level.py").write_text(LEVEL)
    place = np.array([0.0, 0.0, 2.0])
    turned = SEEN._replace(pose=place)
    still = Reference(np.zeros(3), np.zeros(3))
    made = {}
    for name in (file(tmp_path, of_the_page()), str(tmp_path / "level.py")):
        controller = registry.build(name, tilted, LOOP)
        controller.reset()
        made[name[-8:]] = controller(turned, still)
    needed = tilted.inverse_dynamics(np.zeros(3), np.zeros(3), pose=place)
    assert made["oller.py"] == pytest.approx(needed)
    assert not np.allclose(made["level.py"], needed, atol=0.05)


def test_a_pose_that_is_not_measured_is_told(tmp_path: Path) -> None:
    text = of_the_page().replace("pose=pose", "pose=observation.pose")
    controller = registry.build(file(tmp_path, text), MODEL, LOOP)
    controller.reset()
    with pytest.raises(InputError, match="pose is None: it is not measured"):
        controller(SEEN, WANTED)
