"""What a person sees on opening a recording: the machine beside its plots."""

import numpy as np
import rerun.blueprint as rrb

from twin.platform import Platform
from twin.platform.mjcf import load_mjcf
from twin.recording.rrd import entity
from twin.recording.schema import TIMELINE
from twin.stream import plots
from twin.stream.scene import WORLD


def blueprint(platform: Platform, *, remarks: bool = False) -> rrb.Blueprint:
    """The layout for a platform: only plots of what it has; `remarks`: below it what is said."""
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
    endless = rrb.TimeRangeBoundary.infinite()
    graphs = [
        rrb.TimeSeriesView(
            origin=path,
            name=title,
            plot_legend=rrb.Corner2D.LeftTop,
            axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=endless, end=endless)),
        )
        for title, path in views
    ]
    columns = 1 if len(graphs) <= 3 else 2
    scene: rrb.Spatial3DView | rrb.Vertical = _machine(platform)
    if remarks:
        words = rrb.TextLogColumns(text_log_columns=["body"])
        said = rrb.TextLogView(origin=plots.SAID, name="what was said", columns=words)
        scene = rrb.Vertical(scene, said, row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Grid(*graphs, grid_columns=columns), column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


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
