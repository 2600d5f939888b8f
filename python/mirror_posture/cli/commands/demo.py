"""`mirror-posture demo`: all steps once, on rendered pictures whose truth is known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from ..._core import MirrorPostureError
from ...counted import counted
from ..output import JsonOption, Output, write_json

ORDER = 1
PANEL = "Start here"
NEEDS_ARGUMENTS = False
PICTURES = ("[0-9]*.png",)
"""The pictures of an earlier run that make room."""


def command(
    out: Annotated[Path, typer.Option(help="Folder for everything that is made.")] = Path("out"),
    postures: Annotated[
        int, typer.Option(help="How many postures are drawn (three pictures each).", min=1, max=6)
    ] = 4,
    seed: Annotated[int, typer.Option(help="Seed of the camera's noise.", min=0)] = 0,
    as_json: JsonOption = False,
) -> None:
    """Render the embedded robot in front of a mirror, measure it from the pictures, diagnose it and correct
    it.

    Two of its joints are off, and the model does not contain that. The measured markers show it, the
    diagnosis names the joints, and a simulated robot with the same errors is corrected in the mirror.
    Everything is written into one folder. The end of the output lists the files and says how far the
    markers are from the truth.

    Example: `mirror-posture demo --out out`
    """
    output = Output(as_json)
    try:
        _all_steps(output, out, postures, seed)
    except KeyboardInterrupt:
        if (out / "session").is_dir():
            output.warn(f"the steps that were finished are kept in {out}; the same command begins anew")
        raise


def _all_steps(output: Output, out: Path, postures: int, seed: int) -> None:
    import numpy as np

    from ...detect import detect_session, read_picture, write_overlay
    from ...measurement import ESTIMATORS, MeasureOptions, measure_all
    from ...measurement.figures import plot_measured_against_model, write_measured_and_model
    from ...measurement.table import document, write_marker_table
    from ...output_files import new_folder
    from ...render import DEMO_OFFSETS_RAD, DEMO_POSTURES, DEMO_VIEWS, TRUTH_FILE, render_session
    from ...session import load_session, write_detections
    from ..demo_robot import demonstrate_correction, demonstrate_diagnosis

    chosen = DEMO_POSTURES[:postures]
    folder = out / "session"
    if folder.exists() and not (folder / TRUTH_FILE).is_file():
        raise MirrorPostureError(
            f"{folder}: is there already, and no demonstration wrote it; give another --out, or it would be replaced"
        )
    total = len(chosen) * len(DEMO_VIEWS)
    output.say(
        f"1. drawing {total} pictures: {counted(len(chosen), 'posture')}, {len(DEMO_VIEWS)} views each, 3 mm of glass, noise"
    )
    with output.counting("drawing", total) as count:
        render_session(
            folder,
            chosen,
            DEMO_VIEWS,
            offsets_rad=DEMO_OFFSETS_RAD,
            seed=seed,
            overwrite=True,
            progress=lambda done, _: count(done),
        )

    output.say("2. looking for the mirrored board and the coloured balls")
    found = detect_session(load_session(folder), progress=lambda chunks: output.chunks(chunks, "detecting"))
    session = found.session
    write_detections(session, folder / "detections.csv")
    with new_folder(out / "detected", PICTURES) as part:
        for row, picture in found.pictures.items():
            file = session.image_files[row]
            if file is not None and picture.ok:
                write_overlay(part / f"{row:04d}.png", read_picture(file), picture)

    output.say("3. measuring the markers by every estimator")
    measurements = measure_all(session, tuple(MeasureOptions(name) for name in ESTIMATORS))
    best = measurements[ESTIMATORS.index("maximum-likelihood")]
    write_marker_table(best, out / "markers.csv")
    write_json(out / "markers.json", document(best))
    plot_measured_against_model(best, out / "measured_against_model.png")
    with new_folder(out / "measured", PICTURES) as part:
        for row in range(len(session.frames)):
            write_measured_and_model(session, best, row, part / f"{row:04d}.png")

    truth = json.loads((folder / TRUTH_FILE).read_text(encoding="utf-8"))
    errors = {m.estimator: _errors_m(session, m, truth) for m in measurements}
    rows = [
        (
            m.estimator,
            str(len(errors[m.estimator])),
            f"{1000.0 * _rms(errors[m.estimator]):.2f}",
            f"{1000.0 * np.max(errors[m.estimator], initial=0.0):.2f}",
            f"{1000.0 * float(np.median(m.markers.std_m[m.markers.measured])):.2f}"
            if m.markers.measured.any()
            else "",
        )
        for m in measurements
    ]
    output.table(
        "Distance of the measured markers from the truth, mm",
        ("*estimator", "markers", "RMS", "largest", "± claimed (median)"),
        rows,
    )
    good = best.markers.measured
    gap = 1000.0 * _rms(best.markers.distance_m[good])
    hidden = ", ".join(f"{name} {np.degrees(value):+.1f}°" for name, value in DEMO_OFFSETS_RAD.items())
    error = 1000.0 * _rms(errors[best.estimator])
    output.say(f"The model misses the markers by {gap:.2f} mm RMS, since it does not know of {hidden}.")
    output.say(f"Measured in the mirror they are {error:.2f} mm RMS from the truth.")

    output.say("4. diagnosing: which joint is off, by how much, and which causes it cannot separate")
    diagnosed = demonstrate_diagnosis(output, session, out / "diagnosis")

    output.say("5. correcting the posture of a simulated robot with the same errors, look by look")
    corrected = demonstrate_correction(output, DEMO_OFFSETS_RAD, chosen[0], seed, out / "convergence.png")

    made = {
        "the pictures, as a session with its truth": folder,
        "what was found in them": out / "detected",
        "measured (ring) and model (cross) in the pictures": out / "measured",
        "measured against model, by marker": out / "measured_against_model.png",
        "the markers with their uncertainty": out / "markers.csv",
        "the same with all covariances": out / "markers.json",
        "the diagnosis, a page for a browser": out / "diagnosis" / "report.html",
    }
    if corrected is not None:
        made["the correction: distance from the target by look"] = out / "convergence.png"
    output.table("What was made", ("*", "~"), [(what, str(path)) for what, path in made.items()])
    output.say(f"next: mirror-posture diagnose {folder} --out {out / 'again'}")
    result: dict[str, Any] = {
        "marker_error_rms_m": {name: _rms(values) for name, values in errors.items()},
        "model_gap_rms_m": gap / 1000.0,
        "markers_measured": int(good.sum()),
        "diagnosis": diagnosed,
        "correction": corrected,
        "made": {path.name: path for path in made.values()},
    }
    output.result(result)


def _errors_m(session: Any, measurement: Any, truth: dict[str, Any]) -> Any:
    """Distances of the measured markers from where the drawn ones really are, in the root frame, m."""
    import numpy as np

    markers = measurement.markers
    first = {int(posture): row for row, posture in reversed(list(enumerate(session.frames.posture)))}
    errors = []
    for k in np.flatnonzero(markers.measured):
        told = truth["frames"][first[int(markers.posture[k])]]["markers"][
            measurement.marker_names[markers.marker[k]]
        ]
        errors.append(np.linalg.norm(markers.point_in_root_m[k] - np.array(told["root_m"])))
    return np.array(errors)


def _rms(values: Any) -> float:
    import numpy as np

    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
