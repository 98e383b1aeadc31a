"""Record what the package does: one JSON file per case, to be compared by compare.py.

    python -m tests.behaviour.record OUT_DIR [--data ../shared/data] [--quick] [--resume]

What is under test is the checkout in the current folder, which the interpreter must have installed.
So the record of another checkout is made from there, with this file:

    cd OTHER && .venv/bin/python HERE/tests/behaviour/record.py OUT_DIR

Only the command line and public names are used, so that the same cases run whatever the inside of
the package looks like. Cases whose logs are absent are left out and named. Ctrl-C keeps the cases
that are finished; --resume goes on from there. Compiled kernels come from the user's cache: set
YOUBOT_CACHE_DIR to an empty folder for a record that owes nothing to earlier runs.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

if not __package__:  # run as a file, from the folder of another checkout
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.behaviour.cases import cases, missing
from tests.behaviour.steps import Case, Code, Runner, StoppedError, clock, write_json

ABOUT = "_about.json"
"""When and with what a record was made: for people, never compared."""

INTERRUPTED, UNUSABLE = 130, 2

PACKAGES = "youbot_env, identification, controllers, youbot_scripts"

WHERE = f"import {PACKAGES}; print(*(module.__file__ for module in ({PACKAGES})), sep='\\n')"


def main(arguments: list[str] | None = None) -> int:
    """Command line: see the module's docstring. The exit status is 0, 2 or 130."""
    parser = argparse.ArgumentParser(description="Record what the package in this folder does.")
    parser.add_argument("out", metavar="OUT_DIR", type=Path)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of logs")
    parser.add_argument("--quick", action="store_true", help="a part that takes about a minute")
    parser.add_argument("--only", metavar="WORD", help="cases whose name contains this")
    parser.add_argument("--resume", action="store_true", help="keep the cases that are there")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once (default: 2)")
    given = parser.parse_args(arguments)

    code = Code(Path.cwd(), given.data.resolve())
    fault = _fault(code, given.out, given.resume)
    if fault:
        print(f"record: {fault}", file=sys.stderr)
        return UNUSABLE
    given.out.mkdir(parents=True, exist_ok=True)
    return record(_chosen(code, given), code, given.out, given.jobs)


def _fault(code: Code, out: Path, resume: bool) -> str | None:
    """Why no record can be made; the worst would be one of other code than was meant."""
    found = subprocess.run(
        [code.python, "-P", "-c", WHERE], capture_output=True, text=True, cwd=code.root.parent
    )
    if found.returncode:
        return f"{code.python} lacks {PACKAGES}; use the checkout's own .venv/bin/python"
    for path in map(Path, found.stdout.splitlines()):
        if not path.resolve().is_relative_to(code.root):
            return f"{code.python} runs the code of {path}, which is not in {code.root}"
    if out.is_dir() and any(out.glob("*.json")) and not resume:
        return f"{out} holds a record: name another folder, or --resume it"
    return None


def _chosen(code: Code, given: argparse.Namespace) -> list[Case]:
    chosen = []
    for case in cases():
        absent = missing(case, code)
        if (given.quick and not case.quick) or (given.only and given.only not in case.name):
            continue
        if absent:
            print(f"left out: {case.name}: {absent[0]} is not in {code.data}")
        elif (given.out / f"{case.name}.json").exists():
            print(f"kept: {case.name}")
        else:
            chosen.append(case)
    return chosen


def record(chosen: list[Case], code: Code, out: Path, jobs: int) -> int:
    """Run cases and write what they do to the folder `out`, a line on each; the exit status."""
    runner, since, seconds = Runner(code), clock(), {}

    def run(case: Case) -> float:
        taken = clock()
        write_json(out / f"{case.name}.json", runner.run(case))
        return taken()

    with ThreadPoolExecutor(jobs) as pool:
        waiting = {pool.submit(run, case): case.name for case in chosen}
        try:
            for count, future in enumerate(as_completed(waiting), 1):
                name = waiting[future]
                seconds[name] = future.result()
                print(f"[{count:>3}/{len(chosen)}] {seconds[name]:6.1f} s  {name}", flush=True)
        except (KeyboardInterrupt, StoppedError):
            print("interrupted: --resume goes on from here", file=sys.stderr)
            _abandon(runner, waiting)
            return INTERRUPTED
        except BaseException:
            _abandon(runner, waiting)
            raise
    _write_about(out, code, seconds)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    core = used.ru_utime + used.ru_stime
    print(f"{len(chosen)} cases in {since():.0f} s ({core:.0f} s of one core): {out}")
    return 0


def _abandon(runner: Runner, waiting: dict[Future[float], str]) -> None:
    for future in waiting:
        future.cancel()
    runner.stop()


def _write_about(out: Path, code: Code, seconds: dict[str, float]) -> None:
    path = out / ABOUT
    if path.exists():  # the cases that were resumed took their time too
        seconds = {**json.loads(path.read_text("utf-8"))["seconds"], **seconds}
    about: dict[str, Any] = {
        "code": str(code.root),
        "data": str(code.data),
        "python": platform.python_version(),
        "seconds": dict(sorted(seconds.items(), key=lambda item: -item[1])),
    }
    write_json(path, about)


if __name__ == "__main__":
    sys.exit(main())
