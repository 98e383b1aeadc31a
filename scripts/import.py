"""Make logs of bags, MCAP files, and tables of any layout."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import JsonOption, console, make_folder, write_result, write_text
from youbot_scripts.shared.tables import show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.importing.import_map import ImportMap
    from identification.importing.importing import Imported, Source

EXAMPLES = (
    "youbot import drive.bag -o drive.csv",
    "youbot import drive.bag --show -o drive.map.toml",
    "youbot import drive.bag -o drive.csv --map drive.map.toml",
    "youbot import wheels.csv mocap.csv -o drive.csv",
    "youbot import monday.mcap tuesday.mcap -o runs/ --map robot.map.toml",
    "youbot import drive.csv -o drive.mcap",
)

MAP_ENDING = ".map.toml"


def main(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="Bags (.bag, .db3, a folder of ROS 2), .mcap, CSV of any layout, Parquet.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="LOG",
            help="The log: .csv, .csv.gz or .parquet; FOLDER/ for a log of each source; .mcap "
            "writes a log for PlotJuggler or Foxglove; with --show, .toml writes the map alone.",
        ),
    ] = None,
    map: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="MAP.toml",
            help="Which column is what, in which unit: a proposal of this command, edited.",
        ),
    ] = None,
    look: Annotated[
        bool, typer.Option("--show", help="Show what is in the sources, and the map.")
    ] = False,
    json: JsonOption = None,
) -> None:
    """Make a log of what another program recorded.

    Several sources are channels of one run (wheels in one file, pose in another) and become one
    log; with a folder as output each becomes a log of its own, and each run of a file, and what
    lies between long gaps. Without --map one is proposed and, where all is plain, used; it is
    written beside the log (LOG.map.toml). What could not be decided is asked: edit that file and
    give it with --map. No map runs code.
    """
    from identification.importing.import_map import read_map
    from youbot_env.errors import InputError

    chosen = read_map(map) if map else None
    out = console(json)
    if output is None and not look:
        raise InputError("where to? -o LOG.csv, or --show to see what the sources hold")
    if output is not None and output.name.lower().endswith(".mcap"):
        from identification.importing.exporting import export_log

        if len(sources) != 1:
            raise InputError(f"{output}: a log is exported alone; name one")
        export_log(sources[0], output)
        out.print(f"{output}: written", soft_wrap=True)
        return
    result = _import(out, sources, output, chosen, look)
    write_result(json, result)


def _import(
    out: Console,
    sources: list[Path],
    output: Path | None,
    chosen: ImportMap | None,
    look: bool,
) -> dict[str, Any]:
    from identification.importing.importing import check_log_ending, open_source
    from youbot_scripts.shared.import_tables import source_tables, source_to_dict

    map_alone = output is not None and output.suffix == ".toml"
    folder = output is not None and _is_folder(output)
    if output is not None and not folder and not map_alone:
        check_log_ending(output)
    runs = [[path] for path in sources] if folder else [sources]
    result: dict[str, Any] = {"sources": [], "logs": []}
    for paths in runs:
        source = open_source(paths, chosen)
        result["sources"].append(source_to_dict(source))
        if look:
            show(out, source_tables(source))
            if not map_alone:  # else it is in the file
                out.print(f"\n{source.map_text}", soft_wrap=True, markup=False, highlight=False)
        _tell_doubts(out, source, asked=look or map_alone)
        if output is None:
            continue
        if map_alone:
            write_text(output, source.map_text)
            out.print(f"map: {output}; edit it and give it with --map", soft_wrap=True)
            break
        target = output / f"{_stem(paths[0])}.csv" if folder else output
        result["logs"] += _write(out, source, target, paths, pieces=folder)
    return result


def _write(
    out: Console, source: Source, target: Path, paths: list[Path], pieces: bool
) -> list[dict[str, Any]]:
    """Write the log, or the logs, of one run, and the map beside it."""
    from identification.importing.importing import import_source, runs_of_source, write_imported
    from youbot_env.errors import InputError

    map_path = target.with_name(_stem(target) + MAP_ENDING)
    if pieces:
        make_folder(target.parent)
    if source.proposal is not None and source.undecided:
        write_text(map_path, source.map_text)
        named = " ".join(shlex.quote(str(path)) for path in paths)
        more = f" (and {len(source.undecided) - 1} more)" if len(source.undecided) > 1 else ""
        raise InputError(
            f"{paths[0]}: {source.undecided[0]}{more}; look at {map_path}, marked CHECK, edit it, "
            f"then: youbot import {named} -o {target} --map {map_path}"
        )
    runs = runs_of_source(source) if pieces else [source]
    made = [import_source(run) for run in runs]
    logs = [part for one in made for part in (one.made.pieces() if pieces else [one.made])]
    logs = [log for log in logs if len(log.time) > 1]
    told = []
    for k, log in enumerate(logs, 1):
        path = target if len(logs) == 1 else target.with_name(f"{_stem(target)}_{k}.csv")
        write_imported(path, log)
        told.append({"log": str(path), "rows": len(log.time), "columns": log.columns})
        _tell(out, path, log)
    for one in made:
        _tell_findings(out, one, pieces, target, paths)
    if source.proposal is not None:
        write_text(map_path, source.map_text)
        out.print(f"map: {map_path}", soft_wrap=True)
    return told


def _is_folder(path: Path) -> bool:
    # Path drops a slash at the end, so the argument itself is looked at.
    asked = any(a.endswith(("/", "\\")) and Path(a) == path for a in sys.argv)
    return path.is_dir() or asked or not path.suffix


def _stem(path: Path) -> str:
    name = path.name
    for ending in (".csv.gz", ".parquet", ".csv", ".bag", ".mcap", ".db3", ".gz", ".txt"):
        if name.lower().endswith(ending):
            return name[: -len(ending)]
    return name


def _tell(out: Console, path: Path, log: Any) -> None:
    span = log.time[-1] - log.time[0]
    rate = (len(log.time) - 1) / span if span > 0 else 0.0
    parts = ", ".join(log.channels)
    out.print(
        f"{path}: {len(log.time)} rows, {span:.1f} s at {rate:.4g} Hz: {parts}", soft_wrap=True
    )


def _tell_findings(
    out: Console, one: Imported, pieces: bool, target: Path, paths: list[Path]
) -> None:
    from identification.importing.importing import gaps

    for finding in one.findings:
        out.print(f"  {finding.level}: {finding}", soft_wrap=True, markup=False)
    for delay in one.delays:
        if delay.certain:
            cure = f"reported only: [velocity] delay = {delay.value:.4f} in the map undoes it"
            out.print(f"  info: {delay}; {cure}", soft_wrap=True, markup=False)
    found = gaps(one.made)
    if found and not pieces:
        start, length = max(found, key=lambda gap: gap[1])
        named = " ".join(shlex.quote(str(path)) for path in paths)
        out.print(
            f"  warning: {len(found)} gap(s), the longest of {length:.3g} s after {start:.9g} s: "
            f"kept; a log for each stretch: youbot import {named} -o {_stem(target)}/",
            style="yellow",
            soft_wrap=True,
            markup=False,
        )


def _tell_doubts(out: Console, source: Source, asked: bool) -> None:
    proposal = source.proposal
    if proposal is None:
        return
    for doubt in proposal.doubts:
        out.print(f"  warning: {doubt}", style="yellow", soft_wrap=True, markup=False)
    for question in proposal.undecided if asked else ():
        out.print(f"  undecided: {question}", style="yellow", soft_wrap=True, markup=False)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
