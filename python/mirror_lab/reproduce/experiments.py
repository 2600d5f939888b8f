"""All experiments in order: each is run, plotted, printed and written as it is finished."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property

from mirror_posture._core import MirrorPostureError

from ..robots import TwinOptions
from . import body, correction, correction_figure, positions, ray_figures, rays, self_rotation, size
from .claims import Experiment
from .observation import DrawingEye, Eye, NoisyEye, Told
from .stand import Stand

NAMES = ("fig7", "fig8", "fig9", "fig10", "fig11", "table1", "fig13", "fig14")
"""The experiments, in the paper's order."""

NOISE_PX = 0.2
"""Standard deviation of corners and ball centres along one axis: what a good detector reaches."""
PICTURE_TRIALS = 5
"""Default repetitions where each look is a drawn picture (seconds each)."""
TABLE_TRIALS = 5
"""How often Table I is measured: as often as the paper corrected."""

Counting = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Opens a bar for a piece of work of so many steps; what it gives is told how many are done."""


@dataclass(frozen=True)
class Options:
    """How the experiments are made."""

    noise_px: float = NOISE_PX
    pictures: bool = False
    trials: int | None = None
    """Repetitions of every measurement. None: the paper's (100 rays, 10 positions, 5 runs), with pictures 5, 5 and 1."""
    seed: int = 0
    only: tuple[str, ...] = NAMES

    def __post_init__(self) -> None:
        if not self.only:
            raise MirrorPostureError(f"only: got no figure, needed some of {', '.join(NAMES)}")
        for name in self.only:
            if name not in NAMES:
                raise MirrorPostureError(f"only: got {name!r}, needed some of {', '.join(NAMES)}")
        if not 0.0 < self.noise_px <= 10.0:
            raise MirrorPostureError(f"noise: got {self.noise_px:g} px, needed above 0 and at most 10")
        if self.trials is not None and self.trials < 2:
            raise MirrorPostureError(f"trials: got {self.trials}, needed at least 2 (a deviation needs two)")

    def repetitions(self, paper: int, picture: int = PICTURE_TRIALS) -> int:
        """How often, where the paper did it so often."""
        return self.trials or (picture if self.pictures else paper)


class Experiments:
    """The experiments of one run; data that two figures share are computed once."""

    def __init__(self, options: Options, counting: Counting) -> None:
        self.options, self._counting = options, counting

    def each(self) -> Iterator[Experiment]:
        """The chosen experiments, one by one."""
        for name in NAMES:
            if name in self.options.only:
                yield getattr(self, f"_{name}")()

    @cached_property
    def _eye(self) -> Eye:
        stand = Stand.load()
        if self.options.pictures:
            return DrawingEye(stand, self.options.seed)
        return NoisyEye(stand, self.options.noise_px, self.options.seed)

    @cached_property
    def _rays_by_distance(self) -> tuple[rays.RayErrors, rays.RayErrors | None]:
        return self._rays("rays against distance", len(rays.DISTANCES_M), rays.against_distance)

    @cached_property
    def _rays_by_angle(self) -> tuple[rays.RayErrors, rays.RayErrors | None]:
        return self._rays("rays against angle", len(rays.ANGLES_DEG), rays.against_angle)

    def _rays(
        self, what: str, views: int, measure: Callable[[Eye, int, Told | None], rays.RayErrors]
    ) -> tuple[rays.RayErrors, rays.RayErrors | None]:
        trials = self.options.repetitions(rays.PAPER_TRIALS)
        with self._told(what, views * trials) as told:
            found = measure(self._eye, trials, told)
        large = rays.larger_noise(self._eye)
        return found, None if large is None else measure(large, trials, None)

    @cached_property
    def _positions(self) -> tuple[positions.PositionErrors, positions.PositionErrors | None]:
        trials = self.options.repetitions(positions.PAPER_TRIALS)
        with self._told("marker positions against angle", 2 * len(rays.ANGLES_DEG) * trials) as told:
            found = positions.position_errors(self._eye, trials, told)
        large = rays.larger_noise(self._eye)
        return found, None if large is None else positions.position_errors(large, trials)

    def _told(self, what: str, total: int) -> _Counter:
        return _Counter(self._counting(what, total))

    def _fig7(self) -> Experiment:
        return ray_figures.fig7(self._eye, *self._rays_by_distance)

    def _fig8(self) -> Experiment:
        figure = ray_figures.fig8(self._eye, *self._rays_by_distance)
        if self.options.pictures:
            return figure
        trials = self.options.trials or size.SWEEP_TRIALS
        return size.added_to(figure, self._eye.stand, trials, self.options.seed)

    def _fig9(self) -> Experiment:
        return ray_figures.fig9(self._eye, *self._rays_by_angle)

    def _fig10(self) -> Experiment:
        return positions.fig10(*self._positions)

    def _fig11(self) -> Experiment:
        return positions.fig11(*self._positions)

    def _table1(self) -> Experiment:
        trials = self.options.repetitions(TABLE_TRIALS)
        with self._told("the hand's error before the correction", 2 * 2 * trials) as told:
            return body.table1(self._twin(self.options.seed), trials, told)

    def _fig13(self) -> Experiment:
        runs = self.options.repetitions(correction.PAPER_RUNS, picture=1)
        return correction_figure.fig13(
            self._twin(self.options.seed), runs, lambda total: self._told("correcting", total)
        )

    def _fig14(self) -> Experiment:
        looks = 2 * (correction.CORRECTIONS + 1 + correction.SPARE_LOOKS)
        with self._told("correcting on its own legs", looks) as told:
            return self_rotation.fig14(self._twin(self.options.seed), told)

    def _twin(self, seed: int) -> TwinOptions:
        return TwinOptions(pictures=self.options.pictures, noise_px=self.options.noise_px, seed=seed)


class _Counter:
    """A progress bar that is advanced by one."""

    def __init__(self, bar: AbstractContextManager[Callable[[int], None]]) -> None:
        self._bar, self._done = bar, 0

    def __enter__(self) -> Told:
        count = self._bar.__enter__()

        def told() -> None:
            self._done += 1
            count(self._done)

        return told

    def __exit__(self, *error: object) -> None:
        self._bar.__exit__(*error)  # type: ignore[arg-type]
