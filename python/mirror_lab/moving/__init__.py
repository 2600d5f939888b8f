"""Sessions in motion whose causes are withheld: pinocchio's ABA, a separate integrator and actuator laws,
the blind check's light.

Nothing here is shared with what it tests: no module of the product is imported where sessions are made.
"""
