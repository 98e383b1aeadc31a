"""What the site adds to the pages in docs/ while it is built (`make docs`).

- The changelog, a page for each command's help, and the API pages, made from what they describe.
- The notebooks, executed and turned into pages with their pictures.
- Formulas in ``math`` blocks as MathML, so that no script is fetched to draw them.
- Sections of README where a page names one on a line of its own, so that they are written once.
- Links out of docs/, which lead somewhere in a checkout and nowhere on a site, as plain text.
- Per cent signs that do not begin a line.
"""

from __future__ import annotations

import ast
import base64
import importlib
import os
import posixpath
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]

PACKAGES = {
    "youbot_env": "Model, effects, simulation, motions and the Gymnasium environments.",
    "identification": "Logs, identification, comparison and diagnosis.",
    "controllers": "Controllers, the closed loop and tuning.",
}

RUN_NOTEBOOKS = "YOUBOT_DOCS_RUN_NOTEBOOKS"
"""Environment variable: with 0 the notebooks' pages are without outputs, and made at once."""

NOTEBOOK_SECONDS = 900
"""A cell that takes longer is an error."""

_SECTION = re.compile(r"^\[README: ([^\]]+)\]\(\S+\)$", re.MULTILINE)
_LINK = re.compile(r"(!?)\[([^\]]+)\]\(([^)\s]+)\)")
_CODE = re.compile(r"^(```.*?^```)$", re.MULTILINE | re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Blocks of ``math`` are drawn here."""
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {})
    fences.setdefault("custom_fences", []).append(
        {"name": "math", "class": "formula", "format": _formula}
    )
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made."""
    pages = {
        "changelog.md": (ROOT / "CHANGELOG.md").read_text("utf-8"),
        "commands.md": "\n".join(_commands()),
        **{f"api/{name}.md": _api(name, about) for name, about in PACKAGES.items()},
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    for notebook in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        for path, content in _executed(notebook).items():
            files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links and pictures relative to the page's place, those out of docs/ as text."""
    source = page.file.src_uri
    # The changelog stands beside docs/: its links begin there.
    folder = ".." if source == "changelog.md" else posixpath.dirname(source)

    def led(match: re.Match[str]) -> str:
        sign, text, target = match.groups()
        if re.match(r"\w+:|#", target):
            return match[0]
        path, _, anchor = target.partition("#")
        path = posixpath.normpath(posixpath.join("docs", folder, path))
        inside = posixpath.relpath(path, "docs")
        if path == "README.md":
            inside, anchor = _README_ANCHORS.get(anchor, ("index.md", ""))
        elif path == "CHANGELOG.md":
            inside = "changelog.md"
        elif not path.startswith("docs/"):
            return text
        here = posixpath.dirname(source) or "."
        anchor = f"#{anchor}" if anchor else ""
        return f"{sign}[{text}]({posixpath.relpath(inside, here)}{anchor})"

    parts = _CODE.split(_SECTION.sub(_readme_section, markdown))
    return "".join(part if k % 2 else _LINK.sub(led, part) for k, part in enumerate(parts))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Numbers keep their per cent signs on their line; code stays as it is typed."""
    parts = _TYPED.split(html)
    return "".join(
        part if k % 2 else _PER_CENT.sub("\u00a0%", part) for k, part in enumerate(parts)
    )


_TYPED = re.compile(r"(<pre\b.*?</pre>|<code\b.*?</code>)", re.DOTALL)
_PER_CENT = re.compile(r"(?<=\d)\s%(?!\w)")

_README_ANCHORS = {
    "equations": ("model.md", "dynamics"),
    "environment": ("environment.md", ""),
    "limits": ("limits.md", ""),
    "log-files": ("log_files.md", ""),
    "write-your-own-effect": ("extending.md", "an-effect"),
}
"""Where the site says what a section of README says."""


def _readme_section(match: re.Match[str]) -> str:
    """The text below a heading of README, with its links as from docs/."""
    readme = (ROOT / "README.md").read_text("utf-8")
    text = readme.split(f"\n## {match[1]}\n")[1].split("\n## ")[0].strip()
    parts = _CODE.split(text)
    return "".join(part if k % 2 else _LINK.sub(_from_docs, part) for k, part in enumerate(parts))


def _from_docs(match: re.Match[str]) -> str:
    sign, text, target = match.groups()
    return match[0] if re.match(r"\w+:|#", target) else f"{sign}[{text}](../{target})"


def _formula(source: str, language: str, class_name: str, *_: Any, **__: Any) -> str:
    """MathML of a block; an empty line parts formulas."""
    from latex2mathml.converter import convert

    formulas = [part for part in re.split(r"\n\s*\n", source.strip()) if part]
    drawn = "".join(f"<p>{convert(formula, display='block')}</p>" for formula in formulas)
    return f'<div class="{class_name}">{drawn}</div>'


def _commands() -> Iterator[str]:
    """The page of the commands, from their own help."""
    from typer.main import get_command

    from youbot_scripts import cli

    yield "# Each command\n"
    yield "What `youbot COMMAND --help` says, for all of them. Units are SI throughout.\n"
    for name, summary in cli.available().items():
        module = importlib.import_module(f"{cli.PACKAGE}.{name}")
        command = get_command(cli.build_app(name)).commands[name]  # pyright: ignore[reportAttributeAccessIssue]
        yield f"## youbot {name}\n\n{summary}\n"
        yield re.sub(r"(?m)^ +", "", module.main.__doc__ or "") + "\n"
        yield "```text\n" + "\n".join(module.EXAMPLES) + "\n```\n"
        yield "| argument or option | default | meaning |\n|---|---|---|"
        for parameter in command.params:
            if parameter.name != "help":
                yield _parameter(parameter)
        yield ""


def _parameter(parameter: Any) -> str:
    """A row of a command's table."""
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    if parameter.param_type_name == "argument":
        names = f"`{parameter.make_metavar(_context(parameter))}`"
    elif parameter.metavar and not parameter.is_flag:
        names += f" `{parameter.metavar}`"
    default = parameter.default
    given = "" if default in (None, False, (), []) or callable(default) else f"`{default}`"
    text = (parameter.help or "").replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;")
    return f"| {names} | {given} | {text} |"


def _context(parameter: Any) -> Any:
    from click import Command, Context

    return Context(Command("youbot"))


def public_names(package: str) -> Iterator[tuple[str, str]]:
    """Name and full path of what a package's ``__init__.pyi`` lists.

    Parameters
    ----------
    package : with dots
    """
    folder = ROOT.joinpath(*package.split("."))
    for node in ast.parse((folder / "__init__.pyi").read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            module = f"{package}.{node.module}"
            inner = ROOT.joinpath(*module.split(".")) / "__init__.pyi"
            within = dict(public_names(module)) if inner.exists() else {}
            for name in node.names:
                yield name.name, within.get(name.name, f"{module}.{name.name}")


def _api(package: str, about: str) -> str:
    """The page of a package's public names."""
    lines = [f"# {package}\n", f"{about} All of it is imported from `{package}`.\n"]
    for name, path in public_names(package):
        lines.append(f"::: {path}\n    options:\n      heading: {name}\n")
    return "\n".join(lines)


def run_notebook(notebook: Path, folder: Path) -> Any:
    """A notebook with its outputs, after a run from the top in a folder.

    Raises
    ------
    CellExecutionError
        If a cell fails.
    """
    import nbformat
    from nbclient import NotebookClient
    from traitlets.config import Config

    content = nbformat.read(notebook, as_version=4)
    with tempfile.TemporaryDirectory() as sockets, _commands_found():
        # Sockets of files: no port that another user of the machine could listen on.
        kernel = {"transport": "ipc", "ip": f"{sockets}/kernel"}
        NotebookClient(
            content,
            timeout=NOTEBOOK_SECONDS,
            resources={"metadata": {"path": str(folder)}},
            config=Config({"KernelManager": kernel}),
        ).execute()
    return content


@contextmanager
def _commands_found() -> Iterator[None]:
    """A notebook's `!youbot` finds this environment's program, activated or not."""
    before = os.environ["PATH"]
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{before}"
    try:
        yield
    finally:
        os.environ["PATH"] = before


def _executed(notebook: Path) -> dict[str, str | bytes]:
    """A notebook's page and pictures by their paths on the site."""
    import nbformat

    if os.environ.get(RUN_NOTEBOOKS) == "0":
        content: Any = nbformat.read(notebook, as_version=4)
    else:
        with tempfile.TemporaryDirectory() as folder:
            content = run_notebook(notebook, Path(folder))
    title, *cells = content.cells
    note = f"*The notebook itself: `docs/notebooks/{notebook.name}` of a checkout.*"
    made: dict[str, str | bytes] = {}
    text = [title.source, note]
    for cell in cells:
        if cell.cell_type == "markdown":
            text.append(cell.source)
            continue
        text.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            text.append(_output(output, f"{notebook.stem}_{len(made)}.png", made))
    made[f"{notebook.stem}.md"] = "\n\n".join(text) + "\n"
    return {f"notebooks/{path}": shown for path, shown in made.items()}


def _output(output: Any, picture: str, made: dict[str, str | bytes]) -> str:
    """Markdown of what a cell has put out; its picture is added to ``made``, by its name."""
    if output.output_type == "stream":
        # What goes to standard error is progress, or a library's talk.
        return f"```text\n{output.text.rstrip()}\n```" if output.name == "stdout" else ""
    data = output.data
    if "image/png" in data:
        made[picture] = base64.b64decode(data["image/png"])
        return f"![What the cell draws]({picture})"
    if "text/html" in data:
        # Blank lines would end the HTML in Markdown.
        return re.sub(r"\n\s*\n", "\n", str(data["text/html"]))
    return f"```text\n{data['text/plain']}\n```"
