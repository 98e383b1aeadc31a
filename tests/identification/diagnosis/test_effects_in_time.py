"""What acts from a time on, in two logs: it is no offset and no gain of one log, and has a law."""

from __future__ import annotations

import pytest

from identification.diagnosis.diagnose import diagnose
from tests.identification.blind_logs import FEW, blind_logs
from youbot_env.model.model_file import load_model

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("kind", "names", "values", "law"),
    [
        ("jet_on_board", FEW[0], {"time": 24.0}, "late_push_on_board"),
        ("jet_on_board", FEW[1], {"time": 24.0}, "late_push_on_board"),
        ("failing_drive", FEW[0], {"time": 30.0}, "uneven_late_lost_torque"),
    ],
)
def test_its_law_is_proposed_and_leaves_the_noise_that_is_told(kind, names, values, law):
    found = diagnose(load_model("paper"), blind_logs(kind, names, values, factor=0.7))
    assert found.verdict == "unknown" and not found.missing
    assert found.proposal is not None and found.proposal.name == law
    floor = found.noise_floor["force_error"]
    # The errors are held out, so a little above.
    assert floor <= found.proposal.force_error < 1.2 * floor
    assert floor < 0.3 * found.steps[-1].force_error


def test_a_load_that_is_put_on_in_one_of_two_logs_is_named():
    values = {"mass": 12.0, "time": 30.0}
    logs = blind_logs("payload_change", FEW[0], values, only_in=("multisine_b",))
    found = diagnose(load_model("paper"), logs)
    assert found.verdict == "effect" and found.missing == ("payload_change",)
    assert found.steps[-1].logs == ("multisine_b",)
