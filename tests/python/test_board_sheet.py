"""The printed board: the PDF is rendered by a renderer of its own, measured, and seen by the project's detectors."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from mirror_posture import MirrorPostureError, cli
from mirror_posture.board_sheet import BoardSheet, recommend, write_board_pdf
from mirror_posture.detect import BoardOptions, DetectionOptions, DetectionSetup, detect_picture

pypdfium2 = pytest.importorskip("pypdfium2")
pytest.importorskip("reportlab")
DPI = 200


def rendered(file: Path, dpi: int = DPI) -> np.ndarray:
    """The PDF's page in grey, by PDFium."""
    page = pypdfium2.PdfDocument(str(file))[0]
    return cv2.cvtColor(page.render(scale=dpi / 72.0).to_numpy(), cv2.COLOR_BGR2GRAY)


def corners_in(picture: np.ndarray, sheet: BoardSheet, via: str, tmp_path: Path) -> np.ndarray:
    file = tmp_path / "picture.png"
    cv2.imwrite(str(file), picture)
    options = DetectionOptions(board=BoardOptions(views=(via,)))  # type: ignore[arg-type]
    view = detect_picture(file, DetectionSetup(sheet.board(), (), None), options=options).boards[0]
    assert view.ok, view.reason
    assert view.corners_px is not None and (view.visible is None or np.all(view.visible))
    return view.corners_px


@pytest.mark.parametrize(
    ("pattern", "corners", "paper"),
    [
        ("chessboard", (7, 4), "a4"),
        ("chessboard", (4, 7), "letter"),
        ("chessboard", (8, 5), "a4"),
        ("charuco", (7, 4), "a4"),
        ("charuco", (6, 5), "letter"),
    ],
)
def test_the_sheet_has_its_size_and_the_axes_that_the_detector_sees(
    pattern: str, corners: tuple[int, int], paper: str, tmp_path: Path
) -> None:
    sheet = BoardSheet(*corners, 0.017, pattern, paper=paper)
    picture = rendered(write_board_pdf(sheet, tmp_path / "board.pdf"))
    metre = DPI / 0.0254
    width, height = sheet.placement().sheet_m
    assert picture.shape == pytest.approx((height * metre, width * metre), abs=1.5)

    direct = corners_in(picture, sheet, "direct", tmp_path).reshape(corners[1], corners[0], 2)
    step_x, step_y = np.diff(direct, axis=1), np.diff(direct, axis=0)
    # The renderer puts edges on whole pixels. Right angles, one scale, and the printed axes: x to the right and y up (or both turned round).
    sign = -1.0 if sheet.axes_turned else 1.0
    np.testing.assert_allclose(step_x, np.broadcast_to([sign * 0.017 * metre, 0.0], step_x.shape), atol=0.7)
    np.testing.assert_allclose(step_y, np.broadcast_to([0.0, -sign * 0.017 * metre], step_y.shape), atol=0.7)
    assert np.mean(step_x[..., 0]) * sign / metre == pytest.approx(0.017, rel=2e-3)

    # In a mirror each corner keeps its name.
    mirrored = corners_in(np.ascontiguousarray(picture[:, ::-1]), sheet, "mirror", tmp_path)
    mirrored[:, 0] = picture.shape[1] - 1 - mirrored[:, 0]
    np.testing.assert_allclose(mirrored.reshape(direct.shape), direct, atol=0.7)


def test_the_rulers_are_100_mm_in_both_directions(tmp_path: Path) -> None:
    sheet = BoardSheet(7, 4, 0.02)
    dpi = 600
    picture = rendered(write_board_pdf(sheet, tmp_path / "board.pdf"), dpi) < 128
    metre = dpi / 0.0254
    # The longest straight dark line below the board is the horizontal ruler, left of it stands the vertical one.
    lowest = picture[-int(0.02 * metre) :, :]
    assert max(_longest(row) for row in lowest) / metre == pytest.approx(0.1, abs=0.0003)
    leftmost = picture[:, : int(0.02 * metre)]
    assert max(_longest(column) for column in leftmost.T) / metre == pytest.approx(0.1, abs=0.0003)


def _longest(line: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


@pytest.mark.parametrize("corners", [(3, 4), (7, 4), (12, 9), (25, 8)])
def test_nothing_is_printed_over_another_thing_or_off_the_page(
    corners: tuple[int, int], tmp_path: Path
) -> None:
    width = 0.13 / (min(corners) + 3)
    sheet = BoardSheet(*corners, min(0.0117, round(width, 4), 0.2 / (max(corners) + 3)))
    picture = rendered(write_board_pdf(sheet, tmp_path / "board.pdf"))
    edge = int(0.004 * DPI / 0.0254)
    assert (picture[:edge] > 250).all() and (picture[-edge:] > 250).all()
    assert (picture[:, :edge] > 250).all() and (picture[:, -edge:] > 250).all()
    # Half a square around the pattern holds the two thin axes and nothing dark.
    placed, metre = sheet.placement(), DPI / 0.0254
    left = int((placed.left_m - 0.2 * sheet.square_m) * metre)
    top = int((placed.sheet_m[1] - placed.bottom_m - sheet.size_m[1] - 0.2 * sheet.square_m) * metre)
    assert (picture[top, left : left + int(sheet.size_m[0] * metre)] > 200).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"corners_x": 7, "corners_y": 5}, "one odd and one even"),
        ({"corners_x": 2}, "3 to 40"),
        ({"square_m": 0.05}, "at most"),
        ({"square_m": float("nan")}, "2 to 200 mm"),
        ({"paper": "b5"}, "a4, letter"),
        ({"pattern": "dots"}, "chessboard, charuco"),
        ({"pattern": "charuco", "dictionary": "DICT_9"}, "DICT_4X4_50"),
        ({"pattern": "charuco", "marker_size_m": 0.03}, "marker_size"),
        # Before, 0 printed codes of 75 %, and a chessboard passed over what only codes have.
        ({"pattern": "charuco", "marker_size_m": 0.0}, "marker_size = 0"),
        ({"pattern": "charuco", "dictionary": ""}, "DICT_4X4_50"),
        ({"marker_size_m": 0.01}, "a marker's size with a chessboard"),
        ({"dictionary": "DICT_4X4_50"}, "a dictionary with a chessboard"),
    ],
)
def test_a_board_that_cannot_be_meant_is_refused(changes: dict[str, object], word: str) -> None:
    with pytest.raises(MirrorPostureError, match=word):
        BoardSheet(**changes)  # type: ignore[arg-type]


def test_the_command_refuses_options_of_codes_for_a_chessboard(tmp_path: Path) -> None:
    file = tmp_path / "board.pdf"
    for words, told in (
        (["--marker-mm", "8"], "leave it away"),
        (["--dictionary", "DICT_4X4_50"], "leave it away"),
        (["--pattern", "charuco", "--marker-mm", "0"], "marker_size = 0"),
    ):
        run = CliRunner().invoke(cli.app, ["board", str(file), *words])
        assert run.exit_code == 1 and told in " ".join(run.stderr.split()) and not file.exists()


def test_the_largest_square_that_is_named_fits() -> None:
    with pytest.raises(MirrorPostureError) as error:
        BoardSheet(7, 4, 0.05)
    largest = float(str(error.value).split("at most ")[1].split(" mm")[0]) / 1000.0
    assert BoardSheet(7, 4, largest).square_m == largest


def test_sizes_grow_with_the_distance_and_shrink_with_the_focal_length() -> None:
    near, far = recommend(0.3, 900.0, 6), recommend(1.5, 900.0, 6)
    # 12 px of 0.6 m of path at 900 px are 8 mm.
    assert near.square_m == pytest.approx(0.008) and near.ball_diameter_m == pytest.approx(0.012)
    assert far.square_m == pytest.approx(0.040) and far.ball_diameter_m == pytest.approx(0.06)
    hues = sorted(colour.hue_deg for colour in near.colours)
    assert min(np.diff([*hues, hues[0] + 360.0])) == pytest.approx(60.0)
    for bad in ((0.0, 900.0, 4), (0.3, float("inf"), 4), (0.3, 900.0, 30)):
        with pytest.raises(MirrorPostureError):
            recommend(*bad)


def test_the_command_prints_what_the_session_needs(tmp_path: Path) -> None:
    file = tmp_path / "board.pdf"
    run = CliRunner().invoke(
        cli.app, ["board", str(file), "--distance-m", "0.4", "--focal-px", "900", "--json"]
    )
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert (
        document["board"]["square"] == pytest.approx(0.011) and len(document["recommended"]["colours"]) == 4
    )
    assert file.read_bytes().startswith(b"%PDF")
    again = CliRunner().invoke(cli.app, ["board", str(file)])
    assert again.exit_code == 1 and "--overwrite" in again.stderr
    small = CliRunner().invoke(cli.app, ["board", str(tmp_path / "s.pdf"), "--square-mm", "5"])
    assert small.exit_code == 0 and "warning" in small.stderr


def test_a_sheet_that_cannot_be_written_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, a missing folder was a fault of the program, and what ended it left a part of a PDF."""
    gone = CliRunner().invoke(cli.app, ["board", str(tmp_path / "gone" / "board.pdf")])
    assert gone.exit_code == 1 and "cannot be written" in " ".join(gone.stderr.split()), gone.stderr
    file = tmp_path / "board.pdf"
    file.write_bytes(b"old")

    def stop(_path: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mirror_posture.output_files._sync", stop)
    with pytest.raises(KeyboardInterrupt):
        write_board_pdf(BoardSheet(7, 4, 0.02), file)
    assert file.read_bytes() == b"old" and list(tmp_path.iterdir()) == [file]
