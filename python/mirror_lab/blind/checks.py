"""Which options of a set of sessions, and which effects in it, contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .accidents import ACCIDENTS
from .effects import VOCABULARY
from .errors import BlindError
from .mistakes import MISTAKES, SLIPS
from .mounting import NOT_BESIDE
from .outside import OUTSIDE

if TYPE_CHECKING:
    from .simulate import Options


def check_options(options: Options, planned: Sequence[str] = ()) -> None:
    """`planned`: the effects that the sessions shall have, where they are not drawn.

    Raises BlindError that names the option and the fix.
    """
    least, most = options.causes
    if not 0 <= least <= most:
        raise BlindError(
            f"causes: got at least {least} and at most {most}; needed a least number up to the largest"
        )
    if not 1 <= options.frames[0] <= options.frames[1]:
        raise BlindError(
            f"frames: got {options.frames[0]} to {options.frames[1]}; needed a least number, from 1, up to the largest"
        )
    if options.renderer == "mitsuba" and not options.pictures:
        raise BlindError(
            "renderer: got mitsuba, which draws pictures; add --pictures, or leave the renderer out"
        )
    if options.outside_beside > 0 and (options.mistakes or options.accidents):
        raise BlindError(
            f"outside beside: got {options.outside_beside} with {'mistakes' if options.mistakes else 'accidents'}, which stand alone; leave one of them out"
        )
    if planned and (options.mistakes or options.accidents):
        raise BlindError(
            f"effect: got {planned[0]} with sessions whose {'mistakes' if options.mistakes else 'accidents'} are drawn; leave one of them out"
        )
    of_log = MISTAKES.keys() | ACCIDENTS.keys() | set(SLIPS)
    for effect in planned:
        if effect not in of_log | VOCABULARY.keys() | OUTSIDE.keys():
            known = ", ".join([*VOCABULARY, *OUTSIDE, *sorted(of_log)])
            raise BlindError(f"unknown effect {effect!r}; known are {known}")
        if options.pictures and effect in of_log:
            raise BlindError(
                f"effect: got {effect} with pictures; mistakes and accidents are made of image points only: leave out --pictures"
            )
        if options.by_hand and effect in NOT_BESIDE:
            why = "is judged with exact mounts only" if effect == "pairing" else "belongs to the set-up"
            raise BlindError(f"effect: got {effect} with a set-up by hand; it {why}: needed an exact set-up")
