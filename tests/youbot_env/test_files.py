"""Files are written whole or not at all, by names that nobody guesses, and read to a bound."""

from __future__ import annotations

import os
import random
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from youbot_env.errors import LONGEST_MESSAGE, InputError, finite, visible
from youbot_env.files import atomic_path, read_bounded, read_bytes, write_atomically, write_json

ROOT = Path(__file__).parents[2]
POSIX = pytest.mark.skipif(os.name != "posix", reason="concerns POSIX files")

# --- writing ---------------------------------------------------------------------------------


@POSIX
def test_permissions_are_the_users_and_those_of_a_file_stay(tmp_path: Path):
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "new.json", "1")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new.json").stat().st_mode) == 0o640
    (tmp_path / "new.json").chmod(0o600)
    write_atomically(tmp_path / "new.json", "2")
    assert stat.S_IMODE((tmp_path / "new.json").stat().st_mode) == 0o600


@POSIX
def test_a_link_in_a_folder_of_others_is_not_written_through(tmp_path: Path):
    """The stand-in's name cannot be guessed; and what is there already is never opened."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    seen = set()
    for _ in range(3):
        with atomic_path(tmp_path / "out.csv.gz") as stand_in:
            seen.add(stand_in.name)
            assert stand_in.name.endswith(".csv.gz") and not stand_in.is_symlink()
            stand_in.write_text("mine")
    assert len(seen) == 3 and victim.read_text() == "precious"


def test_taken_names_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / ".aa.json").write_text("taken")
    names = iter(["aa", "aa", "bb"])
    monkeypatch.setattr("youbot_env.files.secrets.token_hex", lambda count: next(names))
    with atomic_path(tmp_path / "x.json") as stand_in:
        assert stand_in.name == ".bb.json"
        stand_in.write_text("1")
    assert (tmp_path / ".aa.json").read_text() == "taken"


def test_a_long_name_has_a_stand_in(tmp_path: Path):
    path = tmp_path / ("x" * 250 + ".json")
    write_atomically(path, "1")
    assert path.read_text() == "1"


@pytest.mark.parametrize("name", ("a\0b", "x" * 300))
def test_a_name_that_no_file_has_is_one_line(name: str, tmp_path: Path):
    with pytest.raises(InputError, match="cannot be written"):
        write_atomically(tmp_path / name, "1")


def test_names_that_are_no_utf8_do_not_stop_a_text(tmp_path: Path):
    write_atomically(tmp_path / "x.html", "log\udcff.csv")
    write_json(tmp_path / "x.json", {"name": "log\udcff.csv"})
    assert (tmp_path / "x.html").read_text() == "log\\udcff.csv"


WRITER = """
import sys, time
from pathlib import Path
from youbot_env.files import atomic_path
while True:
    with atomic_path(sys.argv[1]) as stand_in:
        with open(stand_in, "wb") as file:
            for _ in range(20):
                file.write(b"n" * 100)
                file.flush()
                time.sleep(0.002)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs kill -9")
def test_a_kill_in_the_middle_of_a_slow_write_leaves_the_old_file_or_the_new(tmp_path: Path):
    path = tmp_path / "out.json"
    path.write_bytes(b"o" * 50)
    draw = random.Random(0)
    for _ in range(5):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        time.sleep(0.4 + 0.1 * draw.random())
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        assert path.read_bytes() in (b"o" * 50, b"n" * 2000)


# --- reading ---------------------------------------------------------------------------------


@POSIX
def test_a_pipe_is_read_to_its_end(tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    content = os.urandom(300_000)

    def write() -> None:
        time.sleep(0.2)
        with pipe.open("wb") as file:
            file.write(content[:100])
            file.flush()
            time.sleep(0.2)
            file.write(content[100:])

    writer = threading.Thread(target=write)
    writer.start()
    assert read_bytes(pipe, 1 << 20) == content
    writer.join()


@POSIX
def test_a_pipe_that_nobody_writes_into_is_one_line(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("youbot_env.files.PATIENCE", 0.1)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="nobody writes into this pipe"):
        read_bytes(tmp_path / "pipe", 1 << 20)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs /dev/zero")
def test_a_device_without_an_end_and_a_large_file_are_not_read(tmp_path: Path):
    with pytest.raises(InputError, match="larger than 1 MiB"):
        read_bounded("/dev/zero", 1 << 20)
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(1 << 40)  # a file with a hole: it takes no room
    start = time.perf_counter()
    with pytest.raises(InputError, match="larger than"):
        read_bytes(large, 1 << 30)
    assert time.perf_counter() - start < 0.5


# --- messages --------------------------------------------------------------------------------


def test_a_message_is_printable_and_of_bounded_length():
    error = InputError("a\x1b[31m\x07\u202eb\r\nc\udcff " + "x" * 10_000_000 + " cure")
    assert str(error).isprintable() and str(error).endswith(" cure")
    assert len(str(error)) <= LONGEST_MESSAGE + 100
    with pytest.raises(InputError) as found:
        finite("m0", "9" * 5_000_000)
    assert len(str(found.value)) < LONGEST_MESSAGE + 100


def test_what_a_terminal_can_show_stays():
    assert visible("m0 = 35.4 ± 0.2 kg m² 机器人 \N{ROBOT FACE}") == (
        "m0 = 35.4 ± 0.2 kg m² 机器人 \N{ROBOT FACE}"
    )
    assert visible("a\N{NO-BREAK SPACE}b") == "a b"
    assert visible("\x1b\x9b\x7f") == r"\x1b\x9b\x7f"
