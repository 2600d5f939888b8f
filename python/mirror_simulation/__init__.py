"""MuJoCo executes the sessions of mirror-posture: `simulate` still postures, cause by cause; `motion` whole motions, whose causes it finds.

The product imports nothing of this package: the command `simulate` and the diagnosis of sessions in motion join by entry points.
"""
