"""The workbench's page: what stands where, and what each click does."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from identification.figures.chart_style import PLAN_HEIGHT
from youbot_env.errors import InputError
from youbot_scripts.interactive import panel, views
from youbot_scripts.interactive.guard import protect
from youbot_scripts.interactive.parts import HIDDEN, NOTHING, themed
from youbot_scripts.interactive.project import Project, Step
from youbot_scripts.interactive.signals import DRIVE_HEIGHT, Drawn, stretches
from youbot_scripts.interactive.worker import DRAWN, Worker, shown_now

REFRESH = 700
"""Milliseconds between two looks at the project."""

GAP = 0.5
"""Seconds: points of the floor plan this near in time make one stretch."""


def build(project: Project, worker: Worker, token: str, port: int) -> Any:
    """The Dash application.

    Parameters
    ----------
    token : without it no request is answered
    port : that it will listen on
    """
    from dash import Dash

    # Everything is served from here: a workbench needs no network.
    app = Dash(
        __name__, title="youbot workbench", update_title="", serve_locally=True,
        assets_folder=str(Path(__file__).parent / "assets"), suppress_callback_exceptions=True,
    )  # fmt: skip
    # A screen reader has to know the language; Dash does not say one.
    app.index_string = app.index_string.replace("<html>", '<html lang="en">')
    app.layout = lambda: views.layout(project, REFRESH)
    hashes = [text.strip("'") for text in app.csp_hashes()]
    protect(app.server, token, port, hashes)
    # The page asks whether the server is still there, and says so when it is not.
    app.server.add_url_rule("/alive", view_func=lambda: ("", 204))
    Callbacks(project, worker).register(app)
    return app


class Callbacks:
    """What each click does."""

    def __init__(self, project: Project, worker: Worker) -> None:
        self.project, self.worker = project, worker
        self._drawn: dict[int, Drawn] = {}

    def register(self, app: Any) -> None:
        """Connect the page's parts."""
        from dash import ALL, Input, Output, State

        app.callback(
            Output("panel", "children"),
            Output("driven", "children"),
            Output("commands", "children"),
            Output("revision", "data"),
            Output("logs", "options"),
            Output("logs", "value"),
            Output("drawn", "data"),
            Output("log", "options"),
            Output("log", "value"),
            Output("plant", "options"),
            Output("beside", "options"),
            Output("pictures", "style"),
            Input("tick", "n_intervals"),
            Input("said", "data"),
            State("revision", "data"),
            State("log", "value"),
        )(self.refresh)
        app.callback(
            Output("said", "data"),
            Input({"do": ALL, "with": ALL}, "n_clicks"),
            State("plant", "value"),
            State("controllers", "value"),
            State("beside", "value"),
            prevent_initial_call=True,
        )(self.clicked)
        app.callback(
            Output("said", "data", allow_duplicate=True),
            Input("logs", "value"),
            prevent_initial_call=True,
        )(self.chosen)
        app.callback(
            Output("said", "data", allow_duplicate=True),
            Input("upload", "contents"),
            State("upload", "filename"),
            prevent_initial_call=True,
        )(self.dropped)
        app.callback(
            Output("message", "children"), Input("said", "data"), prevent_initial_call=True
        )(lambda said: (said or {}).get("error", ""))
        app.callback(
            Output("signals", "figure"),
            Output("signals", "style"),
            Input("drawn", "data"),
            Input("log", "value"),
            Input("kind", "value"),
            Input("span", "data"),
            Input("marked", "data"),
        )(self.signals)
        app.callback(
            Output("plan", "figure"),
            Output("plan", "style"),
            Input("drawn", "data"),
            Input("log", "value"),
            Input("marked", "data"),
        )(self.plan)
        app.callback(
            Output("residual", "figure"), Output("residual", "style"), Input("drawn", "data")
        )(self.residual)
        app.callback(Output("drive", "figure"), Output("drive", "style"), Input("drawn", "data"))(
            self.drive
        )
        app.callback(
            Output("span", "data"),
            Input("signals", "relayoutData"),
            Input("log", "value"),
            Input("drawn", "data"),
            Input("marked", "data"),
            State("span", "data"),
            prevent_initial_call=True,
        )(self.zoomed)
        app.callback(
            Output("marked", "data"),
            Input("plan", "selectedData"),
            Input("signals", "selectedData"),
            Input("log", "value"),
            Input("unmark", "n_clicks"),
            prevent_initial_call=True,
        )(self.brushed)
        app.callback(
            Output("download", "data"),
            Input({"save": ALL}, "n_clicks"),
            prevent_initial_call=True,
        )(self.saved)

    # --- the project ------------------------------------------------------------------------

    def refresh(
        self, _: int, said: object, known: int | None, log: int | None
    ) -> tuple[object, ...]:
        """The panel, where something has changed since the page was drawn."""
        from dash import ctx, no_update

        project = self.project
        if known == project.revision and ctx.triggered_id != "said":
            return (no_update,) * 12
        with project.lock:
            drawn = {what: step and step.number for what, step in shown_now(project).items()}
            shown = self._open(drawn["model"])
            names = shown.about["logs"] if shown else []
            choices = [{"label": name, "value": k} for k, name in enumerate(names)]
            chosen = log if log is not None and log < len(names) else 0
            return (
                panel.panel(project), panel.driven(project), panel.commands(project),
                project.revision,
                [{"label": name, "value": name} for name in project.logs], project.chosen,
                drawn, choices, chosen,
                views.models_of(project, views.PLANT), views.models_of(project, views.BESIDE),
                {} if shown else HIDDEN,
            )  # fmt: skip

    def clicked(
        self, counts: list[int | None], plant: str, controllers: list[str], beside: str
    ) -> Any:
        """A button of the page was pressed: what it does becomes a command."""
        from dash import ctx, no_update

        pressed = ctx.triggered_id
        # A button that has just been drawn counts as changed, but nobody pressed it.
        if not pressed or not any(counts) or not ctx.triggered[0]["value"]:
            return no_update
        return self._answer(
            lambda: self._do(pressed["do"], pressed["with"], plant, controllers, beside)
        )

    def _do(self, what: str, which: str, plant: str, controllers: list[str], beside: str) -> None:
        project = self.project
        acts: Mapping[str, Callable[[], Step | list[Step] | None]] = {
            "doctor": project.doctor,
            "identify": project.identify,
            "compare": lambda: project.compare(beside or ""),
            "diagnose": project.diagnose,
            "add": lambda: project.add(which),
            "drive": lambda: project.drive(
                project.model if plant in (views.ACTIVE, "", None) else plant,
                self._known(controllers),
            ),
            "undo": project.undo,
            "cancel": lambda: self.worker.cancel(int(which)),
        }
        steps = acts[what.removeprefix("next-")]()
        for step in steps if isinstance(steps, list) else [steps] if steps else []:
            self.worker.put(step)

    @staticmethod
    def _known(controllers: list[str]) -> list[str]:
        from controllers.registry import CONTROLLERS

        found = [name for name in controllers or [] if name in CONTROLLERS]
        if not found:
            raise InputError("choose a controller first")
        return found

    def chosen(self, names: list[str]) -> Any:
        """Logs were ticked."""
        from dash import no_update

        if list(names) == self.project.chosen:
            return no_update  # the page shows what is chosen already
        return self._answer(lambda: self.project.choose(names))

    def dropped(self, contents: list[str] | None, names: list[str] | None) -> Any:
        """Files were dropped."""

        def keep() -> None:
            for content, name in zip(contents or [], names or [], strict=True):
                try:
                    data = base64.b64decode(content.partition(",")[2], validate=True)
                except (binascii.Error, ValueError):
                    raise InputError(f"{name}: did not arrive whole; drop it again") from None
                self.project.dropped(name, data)

        return self._answer(keep)

    def _answer(self, act: Callable[[], object]) -> dict[str, Any]:
        """What a click has led to: an error line, or nothing; never a traceback."""
        try:
            act()
        except InputError as error:
            return {"error": str(error), "at": self.project.revision}
        return {"error": "", "at": self.project.revision}

    def saved(self, counts: list[int | None]) -> Any:
        """A download was asked for."""
        from dash import ctx, dcc, no_update

        if not ctx.triggered_id or not ctx.triggered[0]["value"]:
            return no_update
        what, project = ctx.triggered_id["save"], self.project
        if what == "script":
            return dcc.send_string(project.script(), "workbench.sh")
        if what == "notebook":
            return dcc.send_string(project.notebook(), "workbench.ipynb")
        path = project.folder / project.model
        if what == "model" and path.exists():
            return dcc.send_file(str(path))
        return no_update

    # --- charts -----------------------------------------------------------------------------

    def _open(self, number: int | None) -> Drawn | None:
        if number is None:
            return None
        if number not in self._drawn:
            self._drawn[number] = Drawn(self.project.home / DRAWN / str(number))
        return self._drawn[number]

    def signals(
        self, drawn: dict[str, int | None] | None, log: int | None, kind: str,
        span: list[float] | None, marked: list[list[float]] | None,
    ) -> tuple[Any, dict[str, str]]:  # fmt: skip
        """Measured and predicted signals."""
        shown = self._open((drawn or {}).get("model"))
        if shown is None or log is None or log >= len(shown.about["logs"]):
            return NOTHING, HIDDEN
        seen = (span[0], span[1]) if span else None
        order = [Path(item["value"]).stem for item in views.models_of(self.project, {})]
        figure, height = shown.signals(kind, log, seen, [(a, b) for a, b in marked or []], order)
        figure.update_layout(uirevision=f"{log}", selectdirection="h")
        if seen:
            figure.update_xaxes(range=list(seen))
        return themed(figure), {"height": f"{height}px"}

    def plan(
        self, drawn: dict[str, int | None] | None, log: int | None, marked: list[list[float]] | None
    ) -> tuple[Any, dict[str, str]]:
        """The floor plan of a log."""
        shown = self._open((drawn or {}).get("model"))
        if shown is None or log is None or log >= len(shown.about["logs"]):
            return NOTHING, HIDDEN
        figure = shown.plan(log, [(a, b) for a, b in marked or []])
        if figure is None:
            return NOTHING, HIDDEN
        return themed(figure), {"height": f"{PLAN_HEIGHT}px"}

    def residual(self, drawn: dict[str, int | None] | None) -> tuple[Any, dict[str, str]]:
        """The residual over the variables that it depends on most."""
        shown = self._open((drawn or {}).get("model"))
        if shown is None or not shown.about["residual"]:
            return NOTHING, HIDDEN
        height = shown.about["heights"][0]
        return themed(shown.about["residual"][0]), {"height": f"{height}px"}

    def drive(self, drawn: dict[str, int | None] | None) -> tuple[Any, dict[str, str]]:
        """Reference and response of the controllers that were driven last."""
        shown = self._open((drawn or {}).get("drive"))
        if shown is None:
            return NOTHING, HIDDEN
        return themed(shown.drive()), {"height": f"{DRIVE_HEIGHT}px"}

    def zoomed(
        self, moved: dict[str, Any] | None, log: int, drawn: object,
        marked: list[list[float]] | None, span: list[float] | None,
    ) -> Any:  # fmt: skip
        """The stretch of time that is looked at: its rows are drawn in full.

        All of the log where something was marked outside of it: nobody would see the mark.
        """
        from dash import ctx, no_update

        if ctx.triggered_id == "marked":
            return None if is_out_of_sight(marked or [], span) else no_update
        if ctx.triggered_id != "signals":
            return None
        found: dict[str, float] = {}
        for key, value in (moved or {}).items():
            if key.startswith("xaxis") and "range[" in key:
                found[key[-2]] = float(value)
            elif key.startswith("xaxis") and key.endswith("autorange"):
                return None
        if len(found) < 2:
            return no_update
        return [found["0"], found["1"]]

    def brushed(
        self, on_plan: dict[str, Any] | None, on_signals: dict[str, Any] | None,
        log: int, _: int | None,
    ) -> Any:  # fmt: skip
        """Stretches of time that were brushed, in a signal or on the floor."""
        from dash import ctx, no_update

        if ctx.triggered_id == "plan" and on_plan and on_plan.get("points"):
            times = [float(point["customdata"]) for point in on_plan["points"]]
            return [list(pair) for pair in stretches(times, GAP)]
        if ctx.triggered_id == "signals" and on_signals and on_signals.get("range"):
            spans = [v for key, v in on_signals["range"].items() if key.startswith("x")]
            return [sorted(map(float, spans[0]))] if spans else []
        # A chart that is drawn anew with its mark says that nothing is selected in it.
        return no_update if ctx.triggered_id in ("plan", "signals") else []


def is_out_of_sight(marked: list[list[float]], span: list[float] | None) -> bool:
    """Whether all marked stretches [s] lie outside the one that is looked at (None: all)."""
    if span is None or not marked:
        return False
    return all(end < span[0] or start > span[1] for start, end in marked)
