"""A plan that is read again: what was changed in it by hand is taken as it stands, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.plan import again
from mirror_posture.plan.options import PlanOptions
from mirror_posture.robots import Nominal
from small_arm import setup

HEAD = "frame,view,center_x_m,center_y_m,center_z_m,normal_x,normal_y,normal_z\n"


def read(nominal: Nominal, folder: Path, *mirrors: str) -> again.PlannedRoom:
    rows = "".join(f"{number},{number},0.0,0.5,0.0\n" for number in range(len(mirrors)))
    (folder / "postures.csv").write_text("frame,posture,pan,lift,elbow\n" + rows)
    views = "".join(f"{number},{mirror}\n" for number, mirror in enumerate(mirrors))
    (folder / "views.csv").write_text(HEAD + views)
    return again.read_planned_room(folder, nominal)


def test_a_mirror_that_was_moved_in_one_row_of_its_view_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, the first row of a view stood for all, and a row was judged before a mirror that it does not have."""
    nominal = Nominal.load(setup(tmp_path))
    monkeypatch.setattr(again, "read_options", lambda file: PlanOptions(mirror_fixed=True))
    there, aside, turned = "0.6,0.0,0.2,1.0,0.0,0.0", "0.6,2.0,0.2,1.0,0.0,0.0", "0.6,0.0,0.2,0.8,0.6,0.0"
    for other, said in (
        (aside, "'center_y_m': got 2, needed 0 as in the first row of view 0"),
        (turned, "'normal_x': got 0.8, needed 1 as in the first row of view 0"),
    ):
        with pytest.raises(MirrorPostureError, match=rf"views.csv: frame 2, column {said}; write the same"):
            read(nominal, tmp_path, f"0,{there}", f"0,{there}", f"0,{other}")
        # All rows of a view, or a view of its own.
        assert len(read(nominal, tmp_path, f"0,{other}", f"0,{other}").mirrors) == 1
        room = read(nominal, tmp_path, f"0,{there}", f"0,{there}", f"1,{other}")
        place = room.mirrors[1]
        told = [float(cell) for cell in other.split(",")]
        assert [*place.center_in_root_m, *place.normal_in_root] == told
