"""The laboratory of mirror-posture: simulated robots, sessions whose cause is withheld, the paper's
experiments.

`mirror_lab.blind` imports nothing of `mirror_posture`; nothing here imports `mirror_posture.diagnosis`, and
the product imports nothing of this package: its commands and robots are added by entry points.
"""
