"""One file for each command.

The module's name is the command's. It has `ORDER` (its place in the help), `PANEL` (its heading there) and
a function `command`, whose docstring is the help. Heavy imports belong inside the function, so that the
help is fast.
"""
