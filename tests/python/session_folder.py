"""A small session on disk, which the tests of loading spoil in one place at a time."""

from __future__ import annotations

from pathlib import Path

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"/>
  <link name="lower"/>
  <link name="hand_marker"/>
  <link name="elbow_marker"/>
  <link name="camera_optical"/>
  <link name="chest_board"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.1"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="hand_mount" type="fixed">
    <parent link="lower"/><child link="hand_marker"/><origin xyz="0 0 -0.1"/>
  </joint>
  <joint name="elbow_mount" type="fixed"><parent link="upper"/><child link="elbow_marker"/></joint>
  <joint name="eye" type="fixed"><parent link="base"/><child link="camera_optical"/></joint>
  <joint name="chest" type="fixed"><parent link="base"/><child link="chest_board"/></joint>
</robot>
"""

SESSION = """format = "mirror-posture/session"
version = 1
robot = "robot.urdf"
camera = "camera.yaml"
root = "base"
gravity = [0.0, 0.0, -9.81]

[camera_mount]
link = "camera_optical"

[board]
link = "chest_board"
corners = [3, 2]
square = 0.014
pattern = "chessboard"

[[markers]]
name = "hand"
link = "hand_marker"
diameter = 0.0116
color = { hue = 0.0, hue_tolerance = 12.0, min_saturation = 0.5, min_value = 0.25 }

[[markers]]
name = "elbow_ball"
link = "elbow_marker"
diameter = 0.0116
mount = "unknown"

[mirror]
glass_thickness = 0.003
refractive_index = 1.52

[noise]
pixel_std = 0.2
point_std = 0.0005

[points]
frame = "unknown"
"""

CAMERA = """image_width: 800
image_height: 600
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [693.0, 0.0, 399.5, 0.0, 694.0, 299.5, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.01, -0.02, 0.001, -0.001, 0.003]}
"""

FRAMES = """frame,posture,time_s,shoulder,elbow,measured:elbow
0,0,0.0,0.1,0.2,0.21
1,0,2.0,0.1,0.2,0.19
5,1,4.0,-0.3,0.4,0.41
"""

DETECTIONS = """frame,target,index,u,v,via
0,board,0,100.5,200.25,mirror
0,board,5,101,201,mirror
0,hand,0,300,310,mirror
1,hand,0,301.5,311.5,direct
5,elbow_ball,0,12,13,mirror
"""

POINTS = """frame,marker,x,y,z
0,hand,0.1,0.2,0.3
5,elbow_ball,-0.1,-0.2,-0.3
"""

FILES = {
    "session.toml": SESSION,
    "robot.urdf": URDF,
    "camera.yaml": CAMERA,
    "frames.csv": FRAMES,
    "detections.csv": DETECTIONS,
    "points.csv": POINTS,
}


def write_folder(folder: Path, **changed: str | None) -> Path:
    """The session's files in a folder; `changed` gives other text by stem, None leaves the file out."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        text = changed.get(name.split(".")[0], text)
        if text is not None:
            (folder / name).write_text(text, encoding="utf-8")
    return folder


def with_accelerometer(link: str) -> str:
    """The frames table with an accelerometer on a link, which was not read in the second frame."""
    cells = [",".join(f"accelerometer:{link}:{axis}" for axis in "xyz"), "0.1,0.2,9.8", ",, ", "0.3,0.4,9.7"]
    return "".join(f"{line},{more}\n" for line, more in zip(FRAMES.splitlines(), cells, strict=True))


def replaced(text: str, old: str, new: str) -> str:
    """The text with one part replaced, which must be there."""
    assert old in text, f"{old!r} is not in the text: the test would prove nothing"
    return text.replace(old, new, 1)


DATA = Path(__file__).parents[3] / "shared" / "data"
"""Sessions and pictures that are not part of the project; tests that need them skip where they are not."""
