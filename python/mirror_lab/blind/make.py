"""Makes sessions whose cause is withheld: draws the causes, simulates, decides which are identifiable, writes, seals the answers."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from .accidents import ACCIDENTS
from .checks import check_options
from .effects import VOCABULARY
from .errors import NoPlaceError, UnstableError
from .identify import judge
from .made_of import begin_set
from .mistakes import kinds_for
from .mounting import NOT_BESIDE
from .outside import OUTSIDE
from .resting import rest_elsewhere
from .seal import seal
from .setup_judge import judge_by_hand
from .shrinkage import keep_pixels
from .simulate import Case, Options, Part, simulate
from .whole_file import remove_unfinished, whole_folder
from .write import write_session

COMBINABLE_ONCE = {
    "camera_mount",
    "camera_focal",
    "camera_center",
    "lens_distortion",
    "mirror_glass",
    "mirror_curvature",
}
"""At most one of these in a session with several causes: two optical ones hide each other."""
ATTEMPTS = 20
NOT_AMONG_SEVERAL = {"geometry", "pairing"}
OF_ONE_CAUSE = {"detectable", "identifiable", "rivals", "gain", "margin", "closest", "chi2_left"}
"""What is judged of each cause."""


def draw_causes(rng: np.random.Generator, options: Options, vocabulary: Sequence[str]) -> list[str]:
    """Names of the causes of one session: none, one to some of the vocabulary, or one from outside it."""
    low, high = options.causes
    if options.mistakes:
        return _mistakes(rng)
    if options.accidents:
        return [str(rng.choice(list(ACCIDENTS)))]
    if options.by_hand:
        vocabulary = [v for v in vocabulary if v not in NOT_BESIDE]
    if low == 0 and rng.random() < options.none_share:
        return []
    if rng.random() < options.outside_share:
        return [str(rng.choice(sorted(OUTSIDE)))]
    number = int(rng.integers(max(1, low), high + 1)) if high >= 1 else 0
    names = _named(rng, number, vocabulary)
    may_have = options.outside_beside > 0 and names and not NOT_AMONG_SEVERAL & set(names)
    # No number is drawn where none is asked for: sets without it stay as they are.
    if may_have and rng.random() < options.outside_beside:
        names.append(str(rng.choice(sorted(OUTSIDE))))
    return names


def _named(rng: np.random.Generator, number: int, vocabulary: Sequence[str]) -> list[str]:
    """So many effects of the vocabulary that may stand in one session."""
    if number == 1:
        return [str(rng.choice(vocabulary))]
    names: list[str] = []
    while len(names) < number:
        effect = str(rng.choice(vocabulary))
        optical = effect in COMBINABLE_ONCE and any(n in COMBINABLE_ONCE for n in names)
        if (
            effect not in NOT_AMONG_SEVERAL
            and not optical
            and not (effect == "board_scale" and effect in names)
        ):
            names.append(effect)
    return names


SMALL = ("joint_offset", "gear_ratio", "link_length", "axis_tilt", "joint_compliance", "camera_focal")
"""The causes that may be drawn beside a mistake: one of each kind."""


def _mistakes(rng: np.random.Generator) -> list[str]:
    """One mistake, two at once, or one with a small cause."""
    style = str(rng.choice(["one", "two", "beside"], p=[0.5, 0.25, 0.25]))
    kinds = kinds_for(rng, 2 if style == "two" else 1)
    if "gravity_sign" in kinds:
        return ["joint_compliance", *kinds]
    if kinds[0] == "slip_marker" or style != "beside":
        return kinds
    return [str(rng.choice(SMALL[:-1])), *kinds]


def save(case: Case, out: Path, rng: np.random.Generator | None = None) -> Path:
    """Write the session to `out/NAME`, its answer to `out/answers/NAME.json` (and `.npz`, the noise-free pixels), its
    seal beside the session."""
    with whole_folder(out / case.name) as folder:
        write_session(case, folder, rng)
        exact = case.logged_off_rad is None and "small" not in case.answer
        if case.mounting is None and case.told is None and exact:
            # The claimed shrinkage is judged only where nothing but the causes differs from what is told.
            case.answer["pixels_sha256"] = keep_pixels(case, out / "answers" / f"{case.name}.npz")
        # The answer is written first, the session with its seal last.
        seal(case.answer, out / "answers" / f"{case.name}.json", folder / "seal.json")
    return out / case.name


@dataclass(frozen=True)
class _Job:
    """All inputs of one session, for another process."""

    out: Path
    number: int
    seed: int
    options: Options
    planned: tuple[str, str, tuple[str, ...]] | None

    @property
    def name(self) -> str:
        return self.planned[0] if self.planned else f"case-{self.number:04d}"

    @property
    def is_made(self) -> bool:
        answer = self.out / "answers" / f"{self.name}.json"
        return (self.out / self.name / "seal.json").is_file() and answer.is_file()


def _make(job: _Job) -> str:
    for attempt in range(ATTEMPTS):
        seed = [job.seed, job.number, *([attempt] if attempt else [])]
        rng = np.random.default_rng(seed)
        if job.planned is None:
            kind = str(rng.choice(list(job.options.robots)))
            draws: Sequence[str] = draw_causes(rng, job.options, sorted(VOCABULARY))
        else:
            _, kind, draws = job.planned
        exact = copy.deepcopy(rng)
        try:
            case = simulate(job.name, kind, draws, rng, job.options)
            parts = _judged_parts(job, kind, draws, exact, case)
            break
        except (NoPlaceError, UnstableError):
            # Three springs on an arm with two loaded joints: this robot cannot have them, or not stand with them; another draw is taken.
            if job.planned is not None or attempt == ATTEMPTS - 1:
                raise
    # The causes are told on the way: which of them can be identified is written into each.
    report, judged = _report(parts)
    # With small errors other frames are seen, and what is drawn after them differs: the session's own values stay.
    pairs = zip(judged, case.answer["causes"], strict=True)
    case.answer |= report | {"seed": seed, "causes": [of_judge | own for of_judge, own in pairs]}
    if job.options.rest_rad > 0 and case.logged_off_rad is None:
        rest_elsewhere(case, job.options.rest_rad, rng)
    save(case, job.out, rng)
    return job.name


def _judged_parts(
    job: _Job, kind: str, draws: Sequence[str], exact: np.random.Generator, case: Case
) -> list[Case]:
    """The sessions in which its causes are judged: what is identifiable is so without small errors beside it, and without an
    effect from outside the vocabulary beside it."""
    if _is_mistaken(case):
        return [case]
    options = replace(job.options, imperfect=0.0)
    if len(draws) > 1 and any(d in OUTSIDE for d in draws):
        parts: tuple[Part, ...] = ("named", "outside")
        return [simulate(job.name, kind, draws, copy.deepcopy(exact), options, part) for part in parts]
    return [case] if job.options.imperfect == 0 else [simulate(job.name, kind, draws, exact, options)]


def _report(parts: Sequence[Case]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the data can show of a session's causes, and these causes in their order; each part is judged by itself."""
    if len(parts) == 1:
        return _judged(parts[0]), parts[0].answer["causes"]
    report: dict[str, Any] = {}
    causes: list[dict[str, Any]] = []
    for part in parts:
        of_part = _judged(part)
        own = part.answer["causes"]
        if len(own) == 1:
            own = [{key: of_part[key] for key in OF_ONE_CAUSE if key in of_part} | own[0]]
        causes += own
        for key in ("detectable", "identifiable"):
            report[key] = report.get(key, True) and all(c[key] for c in own)
    return report, causes


def _is_mistaken(case: Case) -> bool:
    return any("mistake" in c for c in case.answer["causes"])


def _judged(case: Case) -> dict[str, Any]:
    """What the data can show of the causes, by the reference that fits the session."""
    mistaken = _is_mistaken(case)
    if case.mounting is not None and not mistaken:
        return judge_by_hand(case, case.mounting)
    if case.told is None and not mistaken:
        return judge(case)
    # A mistake moves everything by far more than the noise; small causes beside it keep their drawn sizes.
    for cause in case.answer["causes"]:
        cause.setdefault("detectable", True)
        cause.setdefault("identifiable", True)
        cause.setdefault("rivals", [])
    return {}


def make_cases(
    out: Path,
    n: int,
    seed: int,
    options: Options | None = None,
    plan: Sequence[tuple[str, str, Sequence[str]]] | None = None,
    workers: int = 1,
    progress: Callable[[str, int], None] | None = None,
) -> list[Path]:
    """Make `n` sessions below `out`; the same seed makes the same sessions, in however many processes. `plan`
    gives (name, robot, effects) instead.

    Sessions that exist are not made again. Raises BlindError where they were made with another seed or other options, and where options
    contradict each other. `progress` receives each session's name and the number of those still to be made.
    """
    options = options or Options()
    check_options(options, [effect for _, _, draws in plan or () for effect in draws])
    of_plan = None if plan is None else {name: [kind, *draws] for name, kind, draws in plan}
    begin_set(out, seed, vars(options), of_plan)
    planned = [None] * n if plan is None else [(name, kind, tuple(draws)) for name, kind, draws in plan]
    jobs = [_Job(out, i, seed, options, p) for i, p in enumerate(planned)]
    for folder in (out, out / "answers"):
        remove_unfinished(folder)
    todo = [job for job in jobs if not job.is_made]
    left = len(todo)

    def told(name: str) -> None:
        nonlocal left
        left -= 1
        if progress is not None:
            progress(name, left)

    if workers <= 1 or len(todo) <= 1:
        for job in todo:
            told(_make(job))
    else:
        # Each process computes on one core: several BLAS threads in each would slow the others.
        for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(threads, "1")
        with ProcessPoolExecutor(min(workers, len(todo)), mp_context=get_context("spawn")) as pool:
            for done in as_completed([pool.submit(_make, job) for job in todo]):
                told(done.result())
    return [out / job.name for job in jobs]
