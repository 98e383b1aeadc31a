"""The frame of the command line: exit statuses, one-line errors, help, and lazy commands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.scripts.processes import heed_interrupts
from youbot_scripts import cli

COMMAND = '''"""Do a job."""

from typing import Annotated

import typer
from youbot_env.errors import InputError
from youbot_scripts.shared.options import JsonOption, SeedOption, write_result

EXAMPLES = ("youbot job --speed 0.5",)


def main(
    names: Annotated[list[str], typer.Argument(help="What to do it to.")],
    speed: Annotated[float, typer.Option(min=0, help="Greatest speed [m/s].")] = 1.0,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Do a job well.

    With care.
    """
    if "bad" in names:
        raise InputError("log.csv, row 3:\\n'x' is no number; remove the row")
    if "bug" in names:
        raise ValueError("a bug")
    if "missing" in names:
        open("no/such/file")
    if "slow" in names:
        import time

        print("started", flush=True)
        time.sleep(60)
    if "much" in names:
        print("\\n".join("line" for _ in range(100_000)))
    write_result(json, {"speed": speed}, seed)
    print("done", *names)
'''


@pytest.fixture
def commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Makes `job` (above) and `broken` (fails on import) the registered commands."""
    package = tmp_path / "fake_commands"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "job.py").write_text(COMMAND)
    (package / "broken.py").write_text('"""Cannot even be imported."""\n\nraise ImportError\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(cli, "PACKAGE", "fake_commands")
    monkeypatch.setattr(cli, "COMMANDS", ("job", "broken", "not_written_yet"))
    monkeypatch.delitem(sys.modules, "fake_commands", raising=False)
    monkeypatch.delitem(sys.modules, "fake_commands.job", raising=False)
    return tmp_path


def start(folder: Path, *arguments: str, **options) -> subprocess.Popen[str]:
    """A process of its own that runs the fake commands."""
    code = (
        f"import sys; sys.path.insert(0, {str(folder)!r}); from youbot_scripts import cli;"
        "cli.PACKAGE, cli.COMMANDS = 'fake_commands', ('job',); sys.exit(cli.main())"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=options.pop("stdout", subprocess.PIPE),
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
        **options,
    )


def one_line(text: str) -> str:
    assert text.count("\n") == 1, text
    assert text.startswith("youbot: ")
    return text


def test_success_is_status_zero(commands, capsys):
    assert cli.main(["job", "a", "b"]) == 0
    assert capsys.readouterr() == ("done a b\n", "")


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["job", "bad"], "log.csv, row 3: 'x' is no number; remove the row"),
        (["job", "missing"], "no/such/file: No such file"),
        (["job"], "see `youbot job --help`"),
        (["job", "a", "--speed", "fast"], "speed"),
        (["job", "a", "--speed", "-1"], "speed"),
        (["job", "a", "--seed", "-1"], "seed"),
        (["job", "a", "--unknown"], "--unknown"),
        (["job", "a", "--json", "no/such/folder/f.json"], "folder no/such/folder does not exist"),
        (["job", "a", "--json", "."], "is a folder"),
        (["unknown"], "unknown"),
        (["not_written_yet"], "not_written_yet"),
        (["--unknown"], "--unknown"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line_and_status_two(commands, capsys, arguments, fragment):
    assert cli.main(arguments) == 2
    printed = capsys.readouterr()
    assert fragment in one_line(printed.err)
    assert printed.err.startswith("youbot: error: ")
    assert printed.out == ""


def test_a_bug_keeps_its_traceback(commands):
    with pytest.raises(ValueError, match="a bug"):
        cli.main(["job", "bug"])


def test_ctrl_c_is_one_line_and_status_130(commands):
    process = start(commands, "job", "slow")
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert (out, err, process.returncode) == ("", "youbot: interrupted\n", 130)


def test_a_reader_that_leaves_early_is_no_error(commands):
    process = start(commands, "job", "much")
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    assert process.wait(timeout=20) == 141


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_one_line(commands):
    with open("/dev/full", "w") as full:
        process = start(commands, "job", "a", stdout=full)
        _, err = process.communicate(timeout=20)
    assert (err, process.returncode) == ("youbot: error: No space left on device\n", 2)


def test_an_output_without_unicode_is_no_error(commands):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    out, err = start(commands, "job", "±", env=environment).communicate(timeout=20)
    assert (out, err) == ("done ?\n", "")


def test_the_help_lists_what_exists_without_importing_it(commands, capsys):
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert "Do a job." in out
    assert "Cannot even be imported." in out
    assert "not_written_yet" not in out
    assert "fake_commands.job" not in sys.modules


def test_the_help_of_a_command_keeps_units_and_examples(commands, capsys):
    assert cli.main(["job", "--help"]) == 0
    out = capsys.readouterr().out
    assert "Greatest speed [m/s]." in out
    assert "\n  Examples:\n    youbot job --speed 0.5\n" in out
    assert max(map(len, out.splitlines())) <= 80


def test_no_command_shows_the_help_and_fails(commands, capsys):
    assert cli.main([]) == 2
    assert "Do a job." in capsys.readouterr().out


def test_version(capsys):
    from importlib.metadata import version

    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"youbot {version('youbot')}\n"


def test_help_is_fast():
    """0.35 s for a person who asks; nothing of the numerical stack is loaded."""
    code = (
        "import sys; from youbot_scripts.cli import main; main(['--help']);"
        "heavy = {'numpy', 'scipy', 'numba', 'rich', 'gymnasium'};"
        "print(*heavy & set(sys.modules), file=sys.stderr)"
    )
    times = []
    for _ in range(5):
        before = time.perf_counter()
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        times.append(time.perf_counter() - before)
        assert (run.returncode, run.stderr.split()) == (0, [])
    assert min(times) < 0.35


REGISTERED = tuple(cli.available())


@pytest.mark.parametrize("name", REGISTERED)
class TestEveryCommand:
    """What holds for each command of the package."""

    def test_summary_is_a_sentence(self, name: str):
        assert cli.available()[name].endswith(".")
        assert len(cli.available()[name]) <= 66, "fits on a line of the help at 80 columns"

    def test_help_shows_each_option_and_an_example(self, name: str, capsys):
        import typer

        command = typer.main.get_command(cli.build_app(name)).commands[name]  # type: ignore
        missing = [option.name for option in command.params if not getattr(option, "help", None)]
        assert not missing, "parameters without a help text"
        assert cli.main([name, "--help"]) == 0
        assert f"  Examples:\n    youbot {name}" in capsys.readouterr().out

    def test_script_runs_by_itself(self, name: str):
        script = Path(cli.__file__).with_name(f"{name}.py")
        run = subprocess.run(
            [sys.executable, str(script), "--help"], capture_output=True, text=True, timeout=60
        )
        assert run.returncode == 0, run.stderr
        assert run.stdout.startswith(f"Usage: youbot {name} ")


class TestCompletion:
    """What a shell offers after Tab, as its script asks for it."""

    @pytest.mark.parametrize(
        ("typed", "offered"),
        [("youbot id", "identify"), ("youbot diagnose --next", "--next-motion")],
    )
    def test_offers_commands_and_options(self, typed, offered, monkeypatch, capsys):
        monkeypatch.setenv("_YOUBOT_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", typed)
        monkeypatch.setenv("COMP_CWORD", str(len(typed.split()) - 1))
        assert cli.main([]) == 0
        assert capsys.readouterr().out.split() == [offered]

    def test_prints_the_script_of_a_shell(self, tmp_path):
        # No shell need be among the parents of a test.
        detection = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
        environment = {**os.environ, "HOME": str(tmp_path), **detection}
        program = [sys.executable, "-m", "youbot_scripts.cli", "--show-completion", "bash"]
        done = subprocess.run(program, capture_output=True, text=True, timeout=60, env=environment)
        assert done.returncode == 0 and "_YOUBOT_COMPLETE=complete_bash" in done.stdout
        assert not list(tmp_path.iterdir())
