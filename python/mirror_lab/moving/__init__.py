"""Sessions in motion whose causes are withheld: pinocchio's ABA, a separate integrator and actuator laws,
the blind check's light.

Nothing is shared with the code under test: no module of the product is imported where sessions are made.
"""
