"""A blind set for other tools: no answer beside the logs, and a score of what they claim."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.fitting.identify import identify
from youbot_env.errors import InputError
from youbot_env.files import write_json
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.blind_bench import tools
from youbot_scripts.blind_bench.claim_scores import score_claims
from youbot_scripts.blind_bench.claims import Claim, read_claims, write_claims
from youbot_scripts.blind_bench.discrepancy import TERMS, boosted_residual, sparse_regression
from youbot_scripts.blind_bench.published import Published, read_table
from youbot_scripts.blind_bench.publishing import code_of, publish
from youbot_scripts.blind_bench.tools import answer_set, torques_of
from youbot_scripts.blind_bench.trials import Spec
from youbot_scripts.cli import main

pytestmark = pytest.mark.slow  # three platforms are simulated, and fitted

SPECS = (Spec("none", 0, 3, 20.0), Spec("floor_tilt", 0, 3, 20.0), Spec("wind", 0, 3, 20.0))


@pytest.fixture(scope="module")
def blind(tmp_path_factory) -> Published:
    folder = tmp_path_factory.mktemp("blind") / "set"
    publish(SPECS, folder)
    return Published(folder)


def perfect(published: Published, code: str) -> Claim:
    """The right answer, with the true torques."""
    planted = [item["name"] for item in published.answer(code)["case"]["planted"]]
    if "wind" in planted:
        claim = Claim("unknown", (), {"site": "world", "variables": ["heading"]})
    else:
        verdict = "effect" if planted else "adequate"
        claim = Claim(verdict, tuple((name,) for name in planted))
    return replace(claim, predictions=f"{code}.csv")


def write_torques(path: Path, time: np.ndarray, effort: np.ndarray) -> None:
    rows = [",".join(map(str, row)) for row in np.column_stack([time, effort]).tolist()]
    head = ",".join(["time", *(f"effort_{wheel}" for wheel in WHEELS)])
    path.write_text("\n".join([head, *rows]) + "\n")


def test_nothing_beside_the_logs_tells_what_was_planted(blind: Published):
    assert set(blind.codes) == set(map(code_of, SPECS))
    for code in blind.codes:
        folder = blind.folder / "cases" / code
        assert {file.name for file in folder.iterdir()} == {
            *("calibration.csv", "multisine_a.csv", "multisine_b.csv", "unseen.csv")
        }
        motion = read_table(folder / "unseen.csv")
        assert not any(name.startswith("effort") for name in motion)
        assert len(motion["time"]) == len(blind.unseen(code))
    text = (blind.folder / "README.md").read_text() + (blind.folder / "cases.json").read_text()
    assert "seed" not in text.replace("a seed of your own", "") and "wind" not in text
    with pytest.raises(InputError, match="is not empty"):
        publish(SPECS, blind.folder)


def test_an_interrupted_set_is_gone_on_with(blind: Published, tmp_path: Path):
    half = tmp_path / "half"
    shutil.copytree(blind.folder, half, ignore=shutil.ignore_patterns("tools"))
    code = code_of(SPECS[0])
    for name in ("cases.json", "README.md", f"answers/{code}.json", f"cases/{code}/unseen.csv"):
        (half / name).unlink()
    with pytest.raises(InputError, match="is not empty"):
        publish([replace(spec, seed=4) for spec in SPECS], half)
    kept = {path: path.stat().st_mtime_ns for path in half.rglob("*.csv")}
    steps: list[None] = []
    publish(SPECS, half, progress=lambda: steps.append(None))
    assert len(steps) == len(SPECS)
    for path in blind.folder.rglob("*"):
        if path.is_file() and "tools" not in path.parts:
            again = half / path.relative_to(blind.folder)
            assert again.read_bytes() == path.read_bytes()
            assert code in str(again) or kept.get(again, 0) in (0, again.stat().st_mtime_ns)


def test_right_answers_have_the_full_score_and_none_have_none(blind: Published, tmp_path: Path):
    claims = {code: perfect(blind, code) for code in blind.codes}
    for code in blind.codes:
        log = blind.unseen(code)
        write_torques(tmp_path / f"{code}.csv", log.time, log.effort)
    write_claims(tmp_path / "good.json", "mine", claims)
    assert read_claims(tmp_path / "good.json") == claims
    found = score_claims(blind, tmp_path / "good.json")
    counts = {key: value["count"] for key, value in found["all"].items() if key != "cases"}
    assert counts == {"right": 3, "wrongly_named": 0, "named_exactly": 2 + 0,
                      "law_right": 1, "error_falls": 2}  # fmt: skip
    write_claims(tmp_path / "none.json", "lazy", {})
    empty = score_claims(blind, tmp_path / "none.json")
    assert empty["unanswered"] == 3 and empty["all"]["right"]["count"] == 0
    assert empty["all"]["error_falls"]["count"] == 0


def test_the_base_model_goes_no_part_of_the_way(blind: Published, tmp_path: Path):
    code = code_of(SPECS[1])
    base, motion = identify(blind.logs(code), recursive=False), blind.motion(code)
    effort = torques_of(base.mechanism, base.model.theta, motion)
    write_torques(tmp_path / "base.csv", motion.time, effort)
    write_claims(tmp_path / "base.json", "base", {code: Claim("adequate", predictions="base.csv")})
    assert score_claims(blind, tmp_path / "base.json")["all"]["error_falls"]["count"] == 0


def test_mistakes_in_answers_are_one_line(blind: Published, tmp_path: Path):
    write_claims(tmp_path / "a.json", "mine", {"12345678": Claim("adequate")})
    with pytest.raises(InputError, match=r"case '12345678' is not in"):
        score_claims(blind, tmp_path / "a.json")
    code = code_of(SPECS[1])
    write_torques(tmp_path / "short.csv", np.zeros(2), np.zeros((2, 4)))
    write_claims(tmp_path / "b.json", "mine", {code: Claim("unknown", predictions="short.csv")})
    with pytest.raises(InputError, match=r"short.csv: 2 rows, where the motion has"):
        score_claims(blind, tmp_path / "b.json")
    (tmp_path / "words.csv").write_text("time,effort_fl\n0,much\n")
    with pytest.raises(InputError, match="a cell is no number"):
        read_table(tmp_path / "words.csv")
    write_json(tmp_path / "c.json", {"schema_version": 1, "tool": "x", "cases": {code: {}}})
    with pytest.raises(InputError, match="verdict"):
        read_claims(tmp_path / "c.json")
    with pytest.raises(InputError, match="holds no blind set"):
        _ = Published(tmp_path).codes
    assert main(["bench", "--score", str(tmp_path / "a.json")]) == 2


def test_a_tool_answers_once_and_one_that_fails_has_answered_nothing(
    blind: Published, tmp_path: Path, monkeypatch, capsys
):
    folder = tmp_path / "set"
    shutil.copytree(blind.folder, folder)
    asked: list[int] = []

    def tool(logs, motion, seed):
        asked.append(seed)
        if len(asked) == 1:
            raise RuntimeError("out of ideas")
        return tools.Answered(Claim("adequate"), np.zeros((len(motion), 4)))

    monkeypatch.setitem(tools.TOOLS, "mine", tool)
    published = Published(folder)
    path = answer_set(published, "mine", seed=4)
    assert asked == [4, 4, 4] and len(read_claims(path)) == 2
    assert "out of ideas" in next((path.parent).glob("*.error.json")).read_text()
    answer_set(published, "mine", seed=4)
    assert len(asked) == 4, "what is answered is not asked again"
    assert main(["bench", "--publish", str(folder), "--score", str(path)]) == 0
    assert "nothing planted: 1 cases" in capsys.readouterr().out
    with pytest.raises(InputError, match="none of youbot, stepwise, sparse, boosted"):
        answer_set(published, "magic")


def test_trees_and_sparse_terms_take_what_is_missing_and_nothing_where_nothing_is(
    blind: Published,
):
    from youbot_env.model.model_file import load_model

    paper, empty, tilted = load_model("paper"), *(code_of(spec) for spec in SPECS[:2])
    assert boosted_residual(paper, blind.logs(empty), 0).verdict == "adequate"
    assert boosted_residual(paper, blind.logs(tilted), 0).verdict == "unknown"
    pytest.importorskip("pysindy")
    assert sparse_regression(paper, blind.logs(empty)).verdict == "adequate"
    found = sparse_regression(paper, blind.logs(tilted))
    assert "floor_tilt" in found.effects and len(TERMS) == 92
    motion, log = blind.motion(tilted), blind.unseen(tilted)
    assert np.corrcoef(found.torques(motion).ravel(), log.effort.ravel())[0, 1] > 0.97
