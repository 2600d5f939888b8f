"""What the diagnosis finds in a session's pictures as they are, and after a webcam's or phone's codec: it may find less, and must invent nothing.

    python tests/python/coded_pictures.py SESSION [--quality 92] [--noise 1.0] [--seeds 1]

SESSION has pictures and truth.json with its `causes`. Each picture is written again as JPEG with colour at half of the resolution (4:2:0), detected and diagnosed.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import mirror_posture as mp


def coded(session: mp.Session, place: Path, quality: int, noise_levels: float, seed: int) -> mp.Session:
    rng = np.random.default_rng(seed)
    files = []
    for number, file in enumerate(session.image_files):
        assert file is not None
        picture = cv2.imread(str(file)).astype(float)
        noisy = np.clip(np.rint(picture + rng.normal(0.0, noise_levels, picture.shape)), 0, 255).astype(
            np.uint8
        )
        new = place / f"{number:03d}.jpg"
        flags = [
            cv2.IMWRITE_JPEG_QUALITY,
            quality,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
        ]
        cv2.imwrite(str(new), noisy, flags)
        files.append(str(new))
    return replace(session, folder=place, frames=replace(session.frames, image=tuple(files)))


def found_in(session: mp.Session) -> list[tuple[str, str, float]]:
    found = mp.diagnose(mp.detect_session(session).session)
    print(f"  verdict {found.verdict}; gap {found.gap}")
    return [(cause.effect, str(cause.at), cause.probability) for cause in found.causes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--quality", type=int, default=92)
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--clean", action="store_true", help="the pictures as they are, too")
    given = parser.parse_args()
    session = mp.load_session(given.session)
    truth = [(c["effect"], c["at"]) for c in json.loads((given.session / "truth.json").read_text())["causes"]]
    print("truth:", truth)
    if given.clean:
        print("as they are:", found_in(session))
    for seed in range(given.seeds):
        with tempfile.TemporaryDirectory() as place:
            found = found_in(coded(session, Path(place), given.quality, given.noise, seed))
        names = [(effect, at) for effect, at, _ in found]
        invented = [name for name in names if name not in truth]
        print(f"4:2:0 quality {given.quality}, seed {seed}: {found}\n  invented: {invented or 'nothing'}")


if __name__ == "__main__":
    main()
