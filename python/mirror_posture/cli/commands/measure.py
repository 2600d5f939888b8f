"""`mirror-posture measure`: marker positions with their uncertainty, compared with the model's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..._core import MirrorPostureError
from ...counted import counted
from ...input_files import given_text
from ..detected import load_detected
from ..output import ExitCode, JsonOption, Output, SessionArgument, write_json
from ..values import required_ending

if TYPE_CHECKING:
    from ...measurement import Measurement
    from ...session import Session

ORDER = 40
PANEL = "Measuring"
ALL = "all"
ROWS_SHOWN = 24


def command(
    session: SessionArgument,
    estimator: Annotated[
        str,
        typer.Option(
            help="pose (Eq. 1 of the paper), pose-snapped, point-pair (Eq. 2), maximum-likelihood, joint; or all, to compare."
        ),
    ] = "maximum-likelihood",
    out: Annotated[
        Path | None, typer.Option(help="Write the markers: .csv, .parquet or .json (with all covariances).")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Write a plot of measured against model: .png, .svg, .pdf.")
    ] = None,
    overlays: Annotated[
        Path | None, typer.Option(help="Folder for the pictures with measured and model positions drawn.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Write a page for a browser: one .html file, no network.")
    ] = None,
    mount: Annotated[
        Path | None, typer.Option(help="Camera-board transform written by `mirror-posture calibrate --out`.")
    ] = None,
    mount_std_mm: Annotated[
        float | None,
        typer.Option(help="How well the model's camera-board transform is known, mm, one axis.", min=0.0),
    ] = None,
    mount_std_deg: Annotated[
        float | None, typer.Option(help="The same of its rotation, degrees.", min=0.0)
    ] = None,
    noise_px: Annotated[
        float | None,
        typer.Option(help="Noise of corners and ball centres, px, one axis; by default as seen.", min=1e-6),
    ] = None,
    rows: Annotated[int, typer.Option(help="How many rows of the long table are shown.", min=0)] = ROWS_SHOWN,
    as_json: JsonOption = False,
) -> None:
    """Measure the marker positions, and compare them with the model's.

    Each view's mirror is estimated from the board's reflection. The views of a posture are combined to
    positions with covariance, in the frame of the session's root link. In a session with pictures only,
    board and balls are detected first. `±` is one standard deviation of the length of the error. `diagnose`
    explains the distance from the model.

    Estimators: `maximum-likelihood` if the camera's mount on the robot is accurately known, `joint` if not;
    `pose` and `point-pair` are the paper's, for comparison.

    Example: `mirror-posture measure my-session --plot gap.png --out markers.csv`

    Next: `mirror-posture diagnose my-session --out diagnosis`
    """
    output = Output(as_json)
    from ...measurement import ESTIMATORS, MeasureOptions, measure_all
    from ...measurement.table import document, summarise, write_marker_table
    from ...measurement.used import used

    if estimator not in (*ESTIMATORS, ALL):
        raise MirrorPostureError(
            f"--estimator: got {estimator!r}, needed one of {', '.join((*ESTIMATORS, ALL))}"
        )
    required_ending(out, "--out", (".csv", ".parquet", ".json"))
    required_ending(plot, "--plot", (".png", ".svg", ".pdf"))
    required_ending(page, "--page", (".html",))
    loaded = load_detected(output, session)
    options = tuple(
        MeasureOptions(
            name,  # type: ignore[arg-type]
            noise_px,
            noise_px,
            None if mount_std_deg is None else math.radians(mount_std_deg),
            None if mount_std_mm is None else mount_std_mm / 1000.0,
            mount=None if mount is None else _read_mount(mount),
        )
        for name in (ESTIMATORS if estimator == ALL else (estimator,))
    )
    measurements = measure_all(loaded, options)
    # With `all`, the best estimator that takes the model's mount as known is shown in full.
    chosen = measurements[ESTIMATORS.index("maximum-likelihood") if estimator == ALL else 0]
    if estimator == ALL:
        _show_comparison(output, measurements)
    _show_rows(output, chosen, rows)
    _show_summary(output, chosen)
    counts = used(loaded, chosen)
    output.say(counts.sentence)
    for warning in chosen.warnings:
        output.warn(warning)
    for row, reason in enumerate(chosen.mirrors.reason):
        if reason is not None:
            output.warn(f"frame {loaded.frames.frame[row]}: no mirror ({reason})")

    result: dict[str, Any] = {**document(chosen), "data": counts}
    written = []
    if out is not None:
        if out.suffix == ".json":
            write_json(out, result)
        else:
            write_marker_table(chosen, out)
        written.append(out)
    if plot is not None:
        from ...measurement.figures import plot_measured_against_model

        plot_measured_against_model(chosen, plot)
        written.append(plot)
    if overlays is not None:
        written += _write_overlays(output, loaded, chosen, overlays)
    if page is not None:
        from ...measurement.page import write_measure_page

        written.append(write_measure_page(loaded, chosen, page))
    for file in written:
        output.say(f"written: {file}")
    if estimator == ALL:
        result["estimators"] = {m.estimator: summarise(m) for m in measurements}
    output.result(result)
    if not chosen.markers.measured.any():
        output.warn(
            "no marker could be measured: a marker needs two views of one posture, with differently oriented mirrors"
        )
        raise typer.Exit(ExitCode.NOTHING)


def _read_mount(file: Path) -> Any:
    import json

    import numpy as np

    from ...measurement import Mount

    needed = "what `calibrate --out` writes"
    text = given_text(file, needed)
    try:
        tree = json.loads(text)
        pose = np.array(tree["camera_from_board"], dtype=float)
        covariance = np.array(tree["covariance"], dtype=float)
    except (ValueError, LookupError, TypeError, RecursionError, OverflowError) as error:
        raise MirrorPostureError(
            f"{file}: is no calibration ({' '.join(str(error).split())}); needed {needed}"
        ) from None
    if (
        pose.shape != (4, 4)
        or covariance.shape != (6, 6)
        or not (np.isfinite(pose).all() and np.isfinite(covariance).all())
    ):
        raise MirrorPostureError(f"{file}: needed camera_from_board (4, 4) and covariance (6, 6), finite")
    turn = pose[:3, :3]
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() < 1e-6 and np.linalg.det(turn) > 0.0
    if not rigid or np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
        raise MirrorPostureError(
            f"{file}: camera_from_board: needed a rotation and a shift, last row 0, 0, 0, 1"
        )
    spread = np.linalg.eigvalsh(covariance)
    if np.abs(covariance - covariance.T).max() > 1e-9 * max(spread[-1], 0.0) or spread[0] < -1e-9 * abs(
        spread[-1]
    ):
        raise MirrorPostureError(
            f"{file}: covariance: needed a symmetric matrix without negative eigenvalues"
        )
    return Mount(pose, covariance)


def _millimetres(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{1000.0 * value:.{digits}f}"


def _show_rows(output: Output, measurement: Measurement, limit: int) -> None:
    markers = measurement.markers
    point, model = markers.point_in_root_m, markers.model_in_root_m
    shown = []
    for k in range(min(len(markers), limit)):
        name = measurement.marker_names[markers.marker[k]]
        where = "  ".join(f"{1000.0 * v:8.2f}" for v in model[k])
        if markers.measured[k]:
            measured = "  ".join(f"{1000.0 * v:8.2f}" for v in point[k])
            last = (_millimetres(markers.std_m[k]), _millimetres(markers.distance_m[k]))
        else:
            measured, last = "", ("", "")
        shown.append(
            (str(markers.posture[k]), name, str(markers.views[k]), measured, last[0], where, last[1])
        )
    if not shown:
        return
    more = len(markers) - len(shown)
    columns = ["posture", "*marker", "views", "measured", "±", "model", "distance"]
    kept = [i for i, column in enumerate(columns) if column != "model" or not output.narrow]
    output.table(
        f"Markers in the root frame, mm (x y z), by {measurement.estimator}",
        [columns[i] for i in kept],
        [[row[i] for i in kept] for row in shown],
        caption=f"and {counted(more, 'more row')}: --rows {len(markers)}, or --out FILE" if more > 0 else "",
    )
    reasons: dict[tuple[str, str], list[str]] = {}
    for k, reason in enumerate(markers.reason):
        if reason is not None:
            name = measurement.marker_names[markers.marker[k]]
            reasons.setdefault((name, reason), []).append(str(markers.posture[k]))
    for (name, reason), postures in reasons.items():
        output.say(
            f"{name}: not measured, {reason} ({'posture' if len(postures) == 1 else 'postures'} {', '.join(postures)})",
            style="dim",
        )


def _show_summary(output: Output, measurement: Measurement) -> None:
    from ...measurement.table import summarise

    rows = [
        (
            row.marker,
            f"{row.measured} of {row.postures}",
            _millimetres(row.std_m),
            _millimetres(row.distance_rms_m),
            _millimetres(row.distance_max_m),
            ""
            if row.offset_in_root_m is None
            else "  ".join(f"{1000.0 * v:+7.2f}" for v in row.offset_in_root_m),
        )
        for row in summarise(measurement)
    ]
    output.table(
        f"By marker, mm, by {measurement.estimator}",
        ("*marker", "postures", "± (median)", "from model, RMS", "largest", "mean offset x y z")[
            : 5 if output.narrow else 6
        ],
        [row[: 5 if output.narrow else 6] for row in rows],
        caption=f"noise: corners {measurement.corner_noise_px:.3f} px, balls {measurement.marker_noise_px:.3f} px, one axis",
    )


def _show_comparison(output: Output, measurements: list[Measurement]) -> None:
    import numpy as np

    rows = []
    for m in measurements:
        good = m.markers.measured
        mirrors = m.mirrors.measured
        rows.append(
            (
                m.estimator,
                f"{good.sum()} of {len(good)}",
                f"{np.sqrt((m.mirrors.corner_rms_px[mirrors] ** 2).mean()):.3f}" if mirrors.any() else "",
                _millimetres(float(np.median(m.markers.std_m[good]))) if good.any() else "",
                _millimetres(float(np.sqrt((m.markers.distance_m[good] ** 2).mean()))) if good.any() else "",
            )
        )
    output.table(
        "The estimators on this session",
        ("*estimator", "markers", "corners RMS px", "± mm (median)", "from model, RMS mm"),
        rows,
    )


def _write_overlays(output: Output, session: Session, measurement: Measurement, folder: Path) -> list[Path]:
    from ...measurement.figures import write_measured_and_model
    from ...output_files import new_folder

    written = False
    with new_folder(folder, ("[0-9]*.png",)) as part:
        for row in output.progress(range(len(session.frames)), "overlays", len(session.frames)):
            file = part / f"{session.frames.frame[row]:04d}.png"
            written |= write_measured_and_model(session, measurement, row, file)
    if not written:
        output.warn("overlays: this session has no pictures")
        return []
    return [folder]
