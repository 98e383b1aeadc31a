"""Sentences about several logs: each is told once, and lists of logs stay short."""

from __future__ import annotations

from dataclasses import replace

from identification.logs.findings import Finding, grouped, names_of
from tests.identification.recordings import recording


def test_few_logs_are_named_and_many_are_counted():
    assert names_of(["a"]) == "a"
    assert names_of(["a", "b"]) == "a and b"
    assert names_of(["a", "b", "c"]) == "a, b and c"
    assert names_of([f"run_{k}" for k in range(12)]) == "run_0 and 11 others"


def test_what_is_wrong_with_several_logs_is_told_once_with_the_span_of_its_numbers():
    told = [(f"idf_{k}", f"{share} % of the rows repeat") for k, share in enumerate((46, 9.5, 48))]
    told.insert(1, ("idf_0", "gyro_z is dead"))
    assert grouped(told) == [
        "idf_0, idf_1 and idf_2: 9.5 to 48 % of the rows repeat",
        "idf_0: gyro_z is dead",
    ]


def test_numbers_in_names_are_no_numbers():
    lines = [("a", "imu1 reads 0.0475 m"), ("b", "imu2 reads 0.0475 m"), ("c", "motor_1 is hot")]
    assert len(grouped(lines)) == 3


def test_a_column_that_the_message_names_is_said_once():
    named = Finding("warning", "velocity_* look like turns/s", None, "velocity_*", "convert it")
    for warning in (named, Finding("warning", "is a lot", None, "velocity_fl", "check the unit")):
        (said,) = replace(recording(), findings=(warning,)).doubts
        assert said.count("velocity_") == 1
