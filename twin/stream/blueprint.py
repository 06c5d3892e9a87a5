"""What a person sees on opening a recording: the machine beside its plots."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from twin.platform import Platform
from twin.platform.mjcf import load_mjcf
from twin.recording.rrd import PALETTE, entity
from twin.recording.schema import TIMELINE
from twin.signals import PREDICTED, RESIDUAL
from twin.stream import plots
from twin.stream.rows import Header
from twin.stream.scene import WORLD

PALE = 0.4
"""How much of its colour a predicted curve keeps, beside the measured one."""


def blueprint(
    platform: Platform, *, remarks: bool = False, streams: Mapping[str, Header] | None = None
) -> rrb.Blueprint:
    """The layout for a platform: only plots of what it has.

    Args:
        platform: what is seen.
        remarks: whether there is a place for what is said, below the machine.
        streams: of the recording, where they are known; what is there as measured, predicted and
            left is shown so, in front of the flight's plots.
    """
    views: list[tuple[str, str]]
    if platform.base.kind == "hinge":
        views = [
            ("joint angle [deg]", plots.JOINT_ANGLE),
            ("joint rate [deg/s]", plots.JOINT_RATE),
            ("joint torque [N m]", plots.JOINT_TORQUE),
        ]
    else:
        views = [
            ("tilt [deg]", plots.TILT),
            ("attitude [deg]", plots.ATTITUDE),
            ("attitude error [deg]", plots.ATTITUDE_ERROR),
            ("rate [deg/s]", plots.RATE),
        ]
        if platform.wheels:
            views += [
                ("wheel speed [rad/s]", plots.WHEEL_SPEED),
                ("wheel torque [N m]", entity("command_wheel_torque")),
            ]
        if platform.stages:
            views.append(("stage position [mm]", plots.STAGE_POSITION))
        views.append(("gravity torque [mN m]", plots.GRAVITY_TORQUE))
    graphs = [_graph(title, path) for title, path in views]
    flight = rrb.Grid(*graphs, grid_columns=1 if len(graphs) <= 3 else 2, name="the flight")
    shown: rrb.Grid | rrb.Tabs = flight
    known = streams or {}
    predicted = [name for name in known if f"{PREDICTED}{name}" in known]
    if predicted:
        pairs = [view for stream in predicted for view in _pair(stream, known)]
        compared = rrb.Grid(*pairs, grid_columns=2, name="measured, predicted, left")
        shown = rrb.Tabs(compared, flight, active_tab=0)
    scene: rrb.Spatial3DView | rrb.Vertical = _machine(platform)
    if remarks:
        words = rrb.TextLogColumns(text_log_columns=["body"])
        said = rrb.TextLogView(origin=plots.SAID, name="what was said", columns=words)
        scene = rrb.Vertical(scene, said, row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(scene, shown, column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _graph(title: str, path: str, **options: Any) -> rrb.TimeSeriesView:
    """Over all time."""
    endless = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeSeriesView(
        origin=path,
        name=title,
        plot_legend=rrb.Corner2D.LeftTop,
        axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=endless, end=endless)),
        **options,
    )


def _pair(
    stream: str, streams: Mapping[str, Header]
) -> tuple[rrb.TimeSeriesView, rrb.TimeSeriesView]:
    """A stream as measured and as predicted; and what is left."""
    header, residual = streams[stream], f"{RESIDUAL}{stream}"
    there = entity(f"{PREDICTED}{stream}")
    style = rr.SeriesLines(
        names=[f"{column} predicted" for column in header.columns],
        colors=[
            tuple(int(255 - PALE * (255 - part)) for part in PALETTE[i % len(PALETTE)])
            for i in range(len(header.columns))
        ],
    )
    both = _graph(
        f"{stream}, measured and predicted [{header.unit}]",
        "/",
        contents=[f"/{entity(stream)}", f"/{there}"],
        overrides={there: style},
    )
    left = f"{stream}, what is left [{streams[residual].unit}]"
    return both, _graph(left, entity(residual))


def _machine(platform: Platform) -> rrb.Spatial3DView:
    """The 3D view, seen from where the MJCF's own viewer stands."""
    model = load_mjcf(platform.model_path)
    center, distance = model.stat.center, 1.5 * model.stat.extent
    azimuth, elevation = np.radians([model.vis.global_.azimuth, model.vis.global_.elevation])
    forward = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return rrb.Spatial3DView(
        origin=WORLD,
        name=platform.title,
        eye_controls=rrb.EyeControls3D(
            position=center - distance * forward, look_target=center, eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=False,
    )
